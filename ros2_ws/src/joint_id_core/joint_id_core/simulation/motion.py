"""Simulation of a motion that excites the parameters of a joint, measured by the sensors of a UR robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real

import numpy as np

from joint_id_core.arguments import require_type
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.models import Model
from joint_id_core.models.transmission import GEAR_RATIO
from joint_id_core.simulation.excitation import STEP_S, STEPS_V, multisine, position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import ur_robot_sensors
from joint_id_core.simulation.simulator import simulate

MOST = 1e7  # samples, which take some GB of memory


def simulate_motion(
    model: Model,
    duration: float = 6.0,
    rate: float = 500.0,
    values: Mapping[str, float] | None = None,
    noise: bool = True,
    seed: int = 0,
) -> Recording:
    """Simulate a joint with known parameters and return the sensor readings.

    Models with a voltage input get voltage steps; the others follow a multisine of the link position. There is no load.

    Args:
        model: from `models.build`.
        duration: length in s.
        rate: sampling rate in Hz.
        values: true values that replace the nominal ones, SI units.
        noise: True for the sensors of a UR robot, False for exact values.
        seed: seed of the noise.

    Raises:
        JointIdError: a length or rate that is not above zero, too many samples, unknown names, values out of bounds,
            what is no model or no number.
    """
    require_type("model", model, Model, 'make it with build("rigid_joint")')
    for name, value in (("duration", duration), ("rate", rate)):
        require_type(name, value, Real, "give a number above 0")
        if not (math.isfinite(value) and value > 0.0):
            raise JointIdError(f"{name} = {value:g}: give a number above 0")
    if duration * rate > MOST:
        count = f"{duration * rate:.2g}"
        raise JointIdError(f"{duration:g} s at {rate:g} Hz are {count} samples: at most {MOST:.0e} are simulated")
    truth = model.values(values)
    exact = _moved(model, np.arange(round(duration * rate) + 1) / rate, truth)
    if not noise:
        return exact
    sensors = ur_robot_sensors(model.gear_ratio(truth))
    known = set(sensors.noise) | {"voltage"}  # the commanded voltage is exact; there is no link velocity sensor
    return sensors.measure(exact, seed, known & set(exact.channels))


def _moved(model: Model, time: Array, truth: dict[str, float]) -> Recording:
    """Return the exact values of every channel of the motion."""
    reference = position_reference()
    gear = model.gear_ratio(truth)
    if model.drive == "voltage":
        level = np.floor(time / STEP_S + 1e-9).astype(int) % len(STEPS_V)
        recording = simulate(model, time, {"voltage": np.array(STEPS_V)[level]}, truth)
    elif "link_position" in model.state_names:
        default = PositionController()  # for GEAR_RATIO; scaled to the same torque at the link for another gear ratio
        scale = GEAR_RATIO / gear
        controller = PositionController(default.k_p * scale, default.k_d * scale, default.limit * scale)
        recording = simulate_closed_loop(model, controller, reference, time, truth)
    else:
        q, dq = reference.value(time), reference.rate(time)
        torque = multisine(time, 0.3, reference.frequencies, seed=2)
        drives = {model.torque_drive: torque / model.torque_constant(truth)} if model.torque_drive else {}
        inputs = {**drives, "link_position": q, "link_velocity": dq}
        x0 = {"motor_position": gear * q[0], "motor_velocity": gear * dq[0]}
        recording = simulate(model, time, inputs, truth, x0)
    channels = {name: values for name, values in recording.channels.items() if name != model.load}
    return Recording(recording.time, channels, source=recording.source)
