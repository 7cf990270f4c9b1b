"""Fields of a sample become signals of the joints: the right ones, in the right unit, on the right side of the gear."""

import pytest
from rclpy.serialization import deserialize_message

from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import FIELDS, JOINT_NAMES
from joint_id_msgs.msg import RobotSignals
from joint_id_ros.options.driver import EXTRA_FIELDS, DriverOptions
from joint_id_ros.robot_signals import SOURCES, STATUS_FIELDS, TYPES, JointMessages

STAMP_NS = 1_700_000_000_123_456_789
MOTOR_POSITIONS = "output_double_register_24..29"
MOTOR_VELOCITIES = "input_double_register_0..5"


def vector(first):
    """Six values that tell which joint and which field they are of."""
    return tuple(first + 0.01 * joint for joint in range(6))


def sample(fields):
    """A different value for every joint of every field."""
    values = {}
    for k, name in enumerate(fields):
        known = FIELDS.get(name)
        values[name] = vector(k + 1.0) if known and known.type.startswith("VECTOR6") else k + 1.0
    return values


def filled(**parameters):
    messages = JointMessages(DriverOptions(**parameters))
    values = sample(messages.fields)
    return written(messages, STAMP_NS, values), values


def written(messages, stamp_ns, values):
    """The messages of a sample as a subscriber sees them."""
    data = messages.write(stamp_ns, values)
    assert tuple(data) == messages.topics
    return {topic: deserialize_message(message, TYPES[topic]) for topic, message in data.items()}


def test_without_further_word_link_position_current_and_motor_velocity_are_published():
    found, values = filled()
    assert set(found) == {"link_states", "motor_states", "robot_signals"}
    assert tuple(found["robot_signals"].joint_temperatures) == values["joint_temperatures"]
    links, motors = found["link_states"], found["motor_states"]
    assert links.name == motors.name == list(JOINT_NAMES)
    assert tuple(links.position) == values["actual_q"]
    assert tuple(links.effort) == values["actual_current"]
    assert list(motors.velocity) == [101.0 * v for v in values["actual_qd"]]
    assert not len(links.velocity) and not len(motors.position) and not len(motors.effort)


def test_all_messages_of_a_sample_carry_its_stamp_and_the_next_sample_replaces_everything():
    messages = JointMessages(DriverOptions(extra_fields=("target_q",)))
    for shift in (0.0, 5.0):
        values = {
            n: tuple(x + shift for x in v) if isinstance(v, tuple) else v for n, v in sample(messages.fields).items()
        }
        found = written(messages, STAMP_NS + int(shift), values)
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in found.values()}
        assert stamps == {(1_700_000_000, 123_456_789 + int(shift))}
        assert tuple(found["link_states"].position) == values["actual_q"]
        assert tuple(found["robot_signals"].target_q) == values["target_q"]


def test_the_gear_ratio_may_differ_by_joint():
    ratios = (101.0, 101.0, 100.0, 50.0, 80.0, 160.0)
    found, values = filled(gear_ratio=ratios)
    assert list(found["motor_states"].velocity) == [r * v for r, v in zip(ratios, values["actual_qd"], strict=True)]


def test_registers_are_taken_as_they_are():
    found, values = filled(motor_position_source=MOTOR_POSITIONS, motor_velocity_source=MOTOR_VELOCITIES)
    assert list(found["motor_states"].position) == [values[f"output_double_register_{24 + k}"] for k in range(6)]
    assert list(found["motor_states"].velocity) == [values[f"input_double_register_{k}"] for k in range(6)]
    assert "actual_qd" not in values


def test_a_motor_position_from_a_field_is_brought_to_the_motor_shaft():
    found, values = filled(motor_position_source="target_q", gear_ratio=(50.0,))
    assert list(found["motor_states"].position) == [50.0 * v for v in values["target_q"]]


def test_what_is_not_measured_is_not_asked_for_and_stays_empty():
    found, values = filled(motor_velocity_source="", current_source="", extra_fields=())
    assert set(found) == {"link_states"}
    assert not len(found["link_states"].effort)
    assert set(values) == {*STATUS_FIELDS, "actual_q"}


def test_temperatures_alone_are_due_twice_a_second_and_with_other_fields_with_every_sample():
    alone, both = (JointMessages(DriverOptions(extra_fields=e)) for e in (EXTRA_FIELDS[:1], EXTRA_FIELDS[:2]))
    stamps = [STAMP_NS + 2_000_000 * k for k in range(1001)]
    values = sample(both.fields)
    due = [stamp for stamp in stamps if "robot_signals" in alone.write(stamp, values)]
    assert due == [STAMP_NS + 500_000_000 * k for k in range(5)]
    assert all(tuple(both.write(STAMP_NS + k, values)) == both.topics for k in range(9))
    assert "robot_signals" in alone.write(STAMP_NS - 3600 * 10**9, values)  # the clock was set back


def test_every_extra_field_goes_where_its_name_says():
    found, values = filled(extra_fields=EXTRA_FIELDS, joints=tuple("abcdef"))
    extra = found["robot_signals"]
    assert extra.name == list("abcdef")
    for name in EXTRA_FIELDS:
        assert tuple(getattr(extra, name)) == values[name]
    found, _ = filled(extra_fields=("joint_temperatures",))
    assert [n for n in EXTRA_FIELDS if len(getattr(found["robot_signals"], n))] == ["joint_temperatures"]


def test_every_field_of_robot_signals_is_one_that_robots_send_for_each_joint():
    kinds = RobotSignals.get_fields_and_field_types()
    assert {kinds[name] for name in EXTRA_FIELDS} == {"sequence<double>"}
    assert {FIELDS[name].type for name in EXTRA_FIELDS} == {"VECTOR6D"}


def test_no_field_is_asked_for_twice():
    messages = JointMessages(DriverOptions(current_source="target_current", extra_fields=("target_current",) * 2))
    assert len(set(messages.fields)) == len(messages.fields)
    assert "target_current" in messages.fields and "actual_current" not in messages.fields


@pytest.mark.parametrize("source", [s.parameter for s in SOURCES])
@pytest.mark.parametrize(
    "text",
    [
        "actual_Q",
        "timestamp",
        "joint_mode",
        "joint_temperatures",  # a vector, in another unit
        "output_double_register_24",
        "output_double_register_24..28",
        "output_double_register_29..24",
        "output_double_register_43..48",
        "output_int_register_24..29",
        "output_double_register_24..29 ",
    ],
)
def test_a_source_that_cannot_be_is_refused_with_what_can(source, text):
    with pytest.raises(JointIdError, match=rf"parameter {source} = .*give one of \w+, \w+.*register_24\.\.29"):
        JointMessages(DriverOptions(**{source: text}))


def test_a_position_is_not_taken_for_a_current():
    with pytest.raises(JointIdError, match="parameter current_source = 'actual_q': give one of target_current, actual"):
        JointMessages(DriverOptions(current_source="actual_q"))


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        (
            {"motor_position_source": MOTOR_POSITIONS, "motor_velocity_source": "output_double_register_29..34"},
            "output_double_register_29 is read for both motor_position_source and motor_velocity_source",
        ),
        ({"motor_position_source": "actual_q"}, "actual_q is read for both link_position_source and"),
        (dict.fromkeys((s.parameter for s in SOURCES), ""), "there is nothing to publish"),
    ],
)
def test_sources_that_do_not_go_together_are_refused(parameters, text):
    with pytest.raises(JointIdError, match=text):
        JointMessages(DriverOptions(**parameters))


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"joints": tuple("abcde")}, r"parameter joints = \[a, b, c, d, e\]: give 6 different names"),
        ({"joints": tuple("abcdea")}, "give 6 different names"),
        ({"gear_ratio": ()}, "parameter gear_ratio has 0 values"),
        ({"gear_ratio": (101.0, 101.0)}, "parameter gear_ratio has 2 values: give one for all joints, or 6"),
        ({"gear_ratio": (0.0,)}, "option gear_ratio = 0.0"),
        ({"gear_ratio": (101.0,) * 5 + (float("nan"),)}, "option gear_ratio = nan"),
        ({"rate": 501.0}, "option rate = 501.0 Hz"),
        ({"client": "telnet"}, "option client = 'telnet': choose one of socket"),
        ({"extra_fields": ("actual_q",)}, "option extra_fields = 'actual_q': choose one of joint_temperatures"),
    ],
)
def test_options_are_checked(parameters, text):
    with pytest.raises(JointIdError, match=text):
        DriverOptions(**parameters)
