"""What a message object holds is what comes out of its bytes, and the other way round, whatever the message."""

import math
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import CONDITIONS, MEASURED_BITS, RAW, SAMPLES
from joint_id_msgs.msg import JointSamples, MotorTorques, MotorVoltages, RobotSignals
from joint_id_ros import conversions as convert
from joint_id_ros.raw_messages import Reader, layout_of
from joint_id_ros.samples import SamplesWriter, to_recordings

from .odd_messages import odd_messages

KINDS = (JointState, JointState, MotorVoltages, MotorTorques, RobotSignals, JointSamples)
TOPICS = list(zip((*RAW, CONDITIONS, SAMPLES), KINDS, strict=True))
FUZZ = settings(deadline=None, max_examples=60, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


def complaint(topic, message):
    """What the check of message objects says; "" for a good message."""
    try:
        convert.check_message(topic, message)
    except JointIdError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("topic", "kind"), TOPICS, ids=[topic.name for topic, _ in TOPICS])
def test_bytes_say_the_same_as_message_objects(topic, kind):
    good, bad = [], []

    @FUZZ
    @given(st.lists(odd_messages(topic, kind), max_size=8), st.integers(1, 4))
    def look(messages, repeats):
        usual = kind(name=["joint", "elbow"])
        setattr(usual, next(iter(topic.fields)), [0.5, math.nan])
        messages = [m for m in (*messages, usual) for _ in range(repeats)]
        found = Reader(topic, kind).read(map(serialize_message, messages))
        assert len(found) == len(messages)
        for raw, message in zip(found, messages, strict=True):
            assert raw.stamp_ns == convert.nanoseconds(message.header.stamp)
            assert raw.name == tuple(message.name)
            assert (str(raw.error) if raw.error else "") == complaint(topic, message)
            (bad if raw.error else good).append(raw)
            held = {c: getattr(message, f) for f, c in topic.fields.items() if len(getattr(message, f))}
            assert set(raw.channels) == set(held)
            for channel, values in held.items():
                np.testing.assert_array_equal(raw.channels[channel], np.array(values))
            assert raw.measured == getattr(message, "measured", 0)

    look()
    assert good and bad


@pytest.mark.parametrize("kind", KINDS[1:])
def test_a_message_is_written_as_rclpy_would(kind):
    message = kind(name=["elbow", "\u00e4\u4e2d"])
    message.header.frame_id = "base"
    message.header.stamp = convert.to_stamp(17)
    fields = [f for f, t in kind.get_fields_and_field_types().items() if t == "sequence<double>"][:2]
    for k, field in enumerate(fields):
        setattr(message, field, [1.0 + k, math.nan])
    layout = layout_of(message)
    numbers = layout.blank(3)
    numbers["sec"] = [1, 2, 3]
    numbers[fields[0]][1] = [7.0, 8.0]
    written = [deserialize_message(data, kind) for data in layout.write(numbers)]
    assert [convert.nanoseconds(m.header.stamp) for m in written] == [10**9 * k + 17 for k in (1, 2, 3)]
    assert [getattr(m, fields[0])[0] for m in written] == [1.0, 7.0, 1.0]
    assert written[1].header.frame_id == "base" and written[1].name == ["elbow", "\u00e4\u4e2d"]
    # The bytes of rclpy may be longer: it leaves unused ones behind the last field.
    assert len(layout.write(numbers)[0]) <= len(serialize_message(message))


def test_the_other_order_of_bytes_is_read_as_well():
    # Stamp, frame_id, number of names, the name, number of values, the value; each length counts the final zero.
    data = b"\0\0\0\0" + struct.pack(">iIIc3xII2s2xId", 3, 4, 1, b"\0", 1, 2, b"a\0", 1, 12.5)
    (raw,) = Reader(RAW[2], MotorVoltages).read([data])
    assert raw.error is None and raw.stamp_ns == 3 * 10**9 + 4 and raw.name == ("a",)
    assert raw.channels["voltage"].tolist() == [12.5]


@pytest.mark.parametrize("damage", [lambda d: d[:-9], lambda d: d[:2], lambda d: b"\7" + d[1:], lambda d: b"",
                                    lambda d: d[:20] + b"\xff\xff\xff\xff" + d[24:]])  # fmt: skip
def test_damaged_bytes_are_an_error_of_that_message_alone(damage):
    message = JointState(name=["a"], position=[1.0], velocity=[2.0], effort=[3.0])
    message.header.stamp = convert.to_stamp(10**9)
    data = layout_of(message).template
    one, two, three = Reader(RAW[0], JointState).read([data, damage(data), data])
    assert one.error is None and three.error is None and three.channels["current"].tolist() == [3.0]
    assert "link_states: a message of" in str(two.error) and "damaged" in str(two.error)


def read(samples):
    """Write samples and read them again."""
    return Reader(SAMPLES, JointSamples).read(SamplesWriter().write(samples))


def test_samples_become_one_recording_a_joint():
    rng = np.random.default_rng(0)
    stamps = [10**18 + k * 2_000_000 for k in range(20)]
    channels = {c: rng.normal(size=(20, 2)) for c in ("link_position", "link_velocity", "current")}
    channels["voltage"] = np.full((20, 2), np.nan)
    channels["current"][3, 1] = np.nan
    messages = read(AlignedSamples(stamps, ["a", "b"], channels, frozenset({"link_velocity"})))
    recordings = to_recordings(messages, stamps[0], "joint_samples")
    assert list(recordings) == ["a", "b"]
    for k, joint in enumerate("ab"):
        r = recordings[joint]
        assert r.joint == joint and r.derived == {"link_velocity"}
        assert set(r.channels) == {"link_position", "link_velocity", "current"}  # the voltage is nowhere known
        np.testing.assert_allclose(r.time, np.arange(20) * 0.002, rtol=0, atol=1e-12)
        for c in r.channels:
            np.testing.assert_array_equal(r[c], channels[c][:, k])


def test_a_joint_that_is_missing_in_some_messages_has_fewer_samples():
    both = read(AlignedSamples([1, 2, 3], ["a", "b"], {"current": np.ones((3, 2))}, frozenset()))
    one = read(AlignedSamples([4, 5], ["a"], {"torque": np.ones((2, 1))}, frozenset({"torque"})))
    recordings = to_recordings(both + one, 0, "joint_samples")
    assert [len(recordings[j]) for j in "ab"] == [5, 3]
    assert np.isnan(recordings["a"]["current"]).tolist() == [False] * 3 + [True] * 2
    assert recordings["a"].derived == {"torque"} and set(recordings["b"].channels) == {"current"}


def test_the_filter_writes_what_it_is_given():
    values = np.arange(6.0).reshape(3, 2)
    samples = AlignedSamples([5, 6, 10**9 + 7], ["a", "b"], {"torque": values, "link_velocity": -values},
                             frozenset({"link_velocity"}))  # fmt: skip
    messages = [deserialize_message(data, JointSamples) for data in SamplesWriter().write(samples)]
    assert [convert.nanoseconds(m.header.stamp) for m in messages] == [5, 6, 10**9 + 7]
    for k, message in enumerate(messages):
        assert message.name == ["a", "b"] and message.measured == MEASURED_BITS["torque"]
        assert list(message.torque) == values[k].tolist() and list(message.link_velocity) == (-values[k]).tolist()
        assert len(message.current) == 0


@pytest.mark.parametrize("load", [[math.nan, math.nan], [1.5, math.nan]], ids=["of none", "of one"])
def test_a_load_that_is_not_known_stays_one_that_is_there(load):
    """A joint without it is not a joint without a load: the identifier must not take it for zero."""
    channels = {"link_position": np.full((3, 2), 0.1), "external_torque": np.tile(load, (3, 1))}
    samples = AlignedSamples([10**9 + k for k in range(3)], ("a", "b"), channels, frozenset({"external_torque"}))
    found = to_recordings(Reader(SAMPLES, JointSamples).read(SamplesWriter().write(samples)), 10**9, "topic")
    for joint, value in zip("ab", load, strict=True):
        np.testing.assert_array_equal(found[joint]["external_torque"], np.full(3, value))
        assert found[joint].derived == {"external_torque"}


def test_samples_without_a_load_get_none():
    samples = AlignedSamples([10**9], ("a",), {"link_position": np.array([[0.1]])}, frozenset())
    found = to_recordings(Reader(SAMPLES, JointSamples).read(SamplesWriter().write(samples)), 10**9, "topic")
    assert "external_torque" not in found["a"]
