"""What is no measurement is held back, with a reason; what is one passes."""

import math

import pytest

from joint_id_core.rtde.fields import FIELDS
from joint_id_core.rtde.gate import Gate
from joint_id_core.rtde.modes import RobotMode, SafetyMode

SIX = (0.0, -1.5, 1.2, 0.0, 0.3, 1.0)
ZERO = (0.0,) * 6


def sample(timestamp=1.0, **changes):
    values = {
        "timestamp": timestamp,
        "actual_q": SIX,
        "actual_qd": ZERO,
        "actual_current": ZERO,
        "target_q": SIX,
        "robot_mode": 7,
        "safety_mode": 1,
        "joint_mode": (253,) * 6,
        "output_double_register_24": 0.0,
    }
    return values | changes


def test_samples_that_are_fit():
    gate = Gate()
    assert [gate.admit(sample(t)) for t in (1.0, 1.002, 1.010, 0.0, 0.002)] == [""] * 5


@pytest.mark.parametrize("field", ["timestamp", "actual_q", "target_q", "output_double_register_24"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_any_value_that_is_not_finite(field, value):
    bad = sample(**{field: (*SIX[:5], value) if isinstance(sample()[field], tuple) else value})
    assert Gate().admit(bad) == "not finite"
    assert Gate().admit(sample(actual_q=(math.inf, -math.inf, *SIX[2:]))) == "not finite"


@pytest.mark.parametrize("field", ["timestamp", "actual_q", "output_double_register_24"])
@pytest.mark.parametrize("value", [1e300, -1e300, 1e10])
def test_any_value_that_no_robot_has(field, value):
    bad = sample(**{field: (*SIX[:5], value) if isinstance(sample()[field], tuple) else value})
    assert Gate().admit(bad) == "too large"
    assert Gate().admit(sample(actual_q=(1e300, -1e300, *SIX[2:]))) == "too large"


def test_status_bits_are_no_quantity():
    assert Gate().admit(sample(robot_status_bits=2**32 - 1)) == ""


def test_a_packet_of_zeros():
    zeros = {name: (0.0,) * 6 if isinstance(value, tuple) else 0 for name, value in sample().items()}
    gate = Gate()
    assert gate.admit(sample(1.0)) == ""
    assert gate.admit(zeros) == "all zeros"
    assert gate.admit(zeros) == "all zeros"
    assert gate.admit(sample(1.002)) == ""


def test_zeros_of_all_that_is_measured():
    """Targets are none; one number that is not zero makes it a measurement."""
    assert Gate().admit(sample(actual_q=ZERO)) == "all zeros"
    assert Gate().admit(sample(actual_q=ZERO, actual_qd=(-0.0,) * 6)) == "all zeros"
    assert Gate().admit(sample(actual_q=ZERO, actual_current=(*ZERO[:5], 1e-300))) == ""


def test_without_any_measured_vector_there_are_no_zeros_to_see():
    values = {"timestamp": 1.0, "target_q": ZERO, "output_double_register_24": 0.0}
    assert Gate().admit(values) == ""


def test_a_robot_that_is_off_is_told_as_such():
    """Its currents and velocities are zero, and where nothing else is asked for that is all there is."""
    off = {"timestamp": 1.0, "actual_qd": ZERO, "actual_current": ZERO, "robot_mode": 3}
    assert Gate().admit(off) == "robot not running: POWER_OFF"
    assert Gate().admit(off | {"robot_mode": 7}) == "all zeros"


def test_repeated_time():
    gate = Gate()
    assert [gate.admit(sample(t)) for t in (1.0, 1.0, 1.002, 1.002)] == [
        "", "repeated timestamp", "", "repeated timestamp",
    ]  # fmt: skip


def test_a_sample_that_was_held_back_for_its_mode_counts_for_the_next():
    gate = Gate()
    assert gate.admit(sample(1.0, robot_mode=5)) == "robot not running: IDLE"
    assert gate.admit(sample(1.0)) == "repeated timestamp"


@pytest.mark.parametrize("mode", [m for m in RobotMode if m is not RobotMode.RUNNING])
def test_a_robot_that_does_not_run(mode):
    assert Gate().admit(sample(robot_mode=int(mode))) == f"robot not running: {mode.name}"


def test_a_mode_without_a_name():
    assert Gate().admit(sample(robot_mode=42)) == "robot not running: unknown (42)"


def test_without_the_mode_every_measurement_passes():
    values = sample()
    del values["robot_mode"]
    assert Gate().admit(values) == ""


@pytest.mark.parametrize("mode", SafetyMode)
def test_safety_stops_pass(mode):
    assert Gate().admit(sample(safety_mode=int(mode))) == ""


def test_every_six_vector_that_is_measured_is_known():
    for f in FIELDS.values():
        if f.type == "VECTOR6D":
            alone = {"timestamp": 1.0, f.name: ZERO}
            assert Gate().admit(alone) == ("" if f.name.startswith("target_") else "all zeros"), f.name
