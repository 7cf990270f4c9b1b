"""What cannot be simulated ends with a message that says where and why."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from joint_id_core.data.signals import channel, positive
from joint_id_core.errors import JointIdError
from joint_id_core.models import DCMotor, HarmonicDrive, Model
from joint_id_core.simulation.simulator import JointSimulator, simulate


@dataclass(frozen=True)
class Shaker(Model):
    """A mass on dry friction under a force of 80 kHz: it starts and stops four times a period."""

    name = "shaker"
    states = (channel("motor_position"), channel("link_position"), channel("motor_velocity"))
    inputs = ()
    parameters = (positive("level", "Nm", "friction", 1.0), positive("w_s", "rad/s", "smoothing", 1.0))

    def derivative(self, x, u, p, ops):
        a, b, w = x
        omega = 2 * math.pi * 8e4
        return (omega * b, -omega * a, 1.3 * a - p.level * ops.direction("motor_velocity", w, p.w_s))


def test_endless_switching_ends_with_time_and_state():
    joint = JointSimulator(Shaker(), x0={"link_position": 1.0}, rtol=1e-4)
    with pytest.raises(JointIdError, match=r"at 0\.000\d+ s: more than 200 changes .*motor_velocity"):
        joint.advance(1.0, {})


@pytest.mark.parametrize(
    ("changes", "voltage", "message"),
    [
        ({"L": 1e-12}, 12.0, "too stiff"),
        ({"J_r": 0.0}, 12.0, "divides by zero.*J_r"),
        ({"L": 0.0}, 12.0, "divides by zero.*L"),
        ({}, 1e308, "not finite"),
        ({}, math.nan, "voltage = nan: must be finite"),
        ({"L": -1.0}, 12.0, "outside its bounds"),
        ({"k": 1.0}, 12.0, "no parameter 'k'"),
    ],
)
def test_what_cannot_be_simulated_ends_with_one_line(changes, voltage, message):
    with pytest.raises(JointIdError, match=message) as error:
        JointSimulator(DCMotor(), changes).advance(0.5, {"voltage": voltage})
    assert "\n" not in str(error.value)


def test_a_diverging_cubic_is_reported_with_time_and_state():
    with pytest.raises(JointIdError, match=r"simulation of harmonic_drive at .* s: .*motor_position"):
        JointSimulator(HarmonicDrive(), x0={"link_position": 1e120}).advance(1.0, {"torque": 0.0})


@pytest.mark.parametrize(
    ("time", "inputs", "message"),
    [
        ([0.0, 0.1], {}, "needs input 'voltage'"),
        ([0.0, 0.1], {"volts": [1.0, 1.0]}, "no input 'volts'"),
        ([0.0, 0.1], {"voltage": [1.0, 1.0, 1.0]}, r"shape \(3,\)"),
        ([0.0, 0.1], {"voltage": [1.0, math.nan]}, "voltage is nan at 0.1 s"),
        ([0.0], {"voltage": [1.0]}, "two instants"),
        ([0.0, 0.0], {"voltage": [1.0, 1.0]}, "time repeats"),
    ],
)
def test_bad_inputs_of_simulate(time, inputs, message):
    with pytest.raises(JointIdError, match=message):
        simulate(DCMotor(), np.array(time), {n: np.array(v) for n, v in inputs.items()})


def test_bad_calls_of_the_simulator():
    with pytest.raises(JointIdError, match="no state 'speed'"):
        JointSimulator(DCMotor(), x0={"speed": 1.0})
    with pytest.raises(JointIdError, match="rtol"):
        JointSimulator(DCMotor(), rtol=1.0)
    with pytest.raises(JointIdError, match=r"k_t .*no default"):
        JointSimulator(HarmonicDrive(actuation="current"))
    joint = JointSimulator(DCMotor())
    with pytest.raises(JointIdError, match="must be positive"):
        joint.advance(0.0, {"voltage": 1.0})
    with pytest.raises(JointIdError, match="voltage is held"):
        joint.advance(0.1, {"voltage": 1.0}, {"voltage": 2.0})
