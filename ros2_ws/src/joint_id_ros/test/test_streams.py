"""How often streams are read."""

from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message

from joint_id_core.formats.topics import SAMPLES
from joint_id_msgs.msg import JointSamples
from joint_id_ros import conversions as convert
from joint_id_ros.options.reading import RELIABLE
from joint_id_ros.streams import READ_S, Streams

PACE_S = 0.02


@pytest.mark.parametrize(("speed", "expected_s"), [(1.0, PACE_S), (1.2, PACE_S), (10.0, READ_S)])
def test_a_recording_that_is_played_fast_is_read_more_often(speed, expected_s):
    node = SimpleNamespace(create_subscription=lambda *_, **__: SimpleNamespace())
    sources = SimpleNamespace(usual=lambda *_: True)
    found = []
    streams = Streams(
        node, {SAMPLES.name: JointSamples}, lambda _, m: found.append(m), sources, RELIABLE, pace_s=PACE_S
    )
    assert streams.read_s == PACE_S
    instant_ns = 10**18
    for _ in range(5):
        instant_ns += round(speed * streams.read_s * 1e9)
        message = JointSamples(name=["joint"], current=[0.5])
        message.header.stamp = convert.to_stamp(instant_ns)
        streams.pass_on({SAMPLES.name: [(serialize_message(message), {})]})
    assert streams.read_s == expected_s
    assert len(found) == 5
