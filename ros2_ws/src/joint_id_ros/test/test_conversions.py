"""Messages and core types hold the same numbers."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import MEASURED_BITS, RAW
from joint_id_core.models import Electromechanical
from joint_id_core.results.estimate import Status, Verdict
from joint_id_msgs.msg import JointEstimate, JointSamples
from joint_id_msgs.msg import ParameterEstimate as ParameterMessage
from joint_id_ros import conversions as convert

LINKS = RAW[0]


def test_channel_bits_status_and_verdict_codes_are_those_of_the_messages():
    for channel, bit in MEASURED_BITS.items():
        assert getattr(JointSamples, channel.upper()) == bit
    for status in Status:
        assert convert.STATUS_CODES[status] == getattr(JointEstimate, status.name) > 0
    for verdict in Verdict:
        assert convert.VERDICT_CODES[verdict] == getattr(ParameterMessage, verdict.name) > 0


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_stamps_keep_every_nanosecond(instant):
    assert convert.nanoseconds(convert.to_stamp(instant)) == instant


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"name": []}, "names no joint"),
        ({"name": ["a", "a"], "position": [0.0, 0.0]}, "twice"),
        ({"name": ["a"], "position": [0.0, 1.0]}, "2 values of position for 1 joints"),
        ({"name": ["a"], "effort": [math.inf]}, "effort of joint a is infinite"),
        ({"name": ["a"], "velocity": [-1e300]}, "velocity of joint a is -1e.300, which no joint can have"),
        ({"name": ["a"]}, "holds no values: fill at least one of position, velocity, effort"),
    ],
)
def test_messages_that_make_no_sense_are_refused_with_topic_and_reason(fields, text):
    with pytest.raises(JointIdError, match=f"link_states: .*{text}"):
        convert.check_message(LINKS, JointState(**fields))


@pytest.mark.parametrize(("sec", "nanosec"), [(-1, 0), (-(2**31), 0), (1, 10**9), (2**31 - 1, 2**32 - 1)])
def test_a_stamp_that_is_no_time_is_refused(sec, nanosec):
    message = JointState(name=["a"], position=[1.0])
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    with pytest.raises(JointIdError, match=f"link_states: a stamp of {sec} s, {nanosec} ns is no time"):
        convert.check_message(LINKS, message)


def test_the_truth_holds_every_parameter_as_fixed_without_deviation():
    model = Electromechanical()
    values = model.values({"k_1": 9000.0})
    m = convert.to_truth_message("joint", model, values, 10**9)
    assert {p.name: p.value for p in m.parameters} == values
    assert {p.verdict for p in m.parameters} == {ParameterMessage.FIXED}
    assert {p.std_dev for p in m.parameters} == {0.0}
