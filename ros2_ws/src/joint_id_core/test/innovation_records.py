"""Recordings that the tests of the innovations estimator share."""

from __future__ import annotations

import functools

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.models import build
from joint_id_core.simulation.excitation import multisine, position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

HARMONIC = build("harmonic_drive")
RIGID = build("rigid_joint")
TORQUE_NOISE = 0.003  # Nm at the motor
SENSORS = Sensors(noise={"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3})
RIGID_TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}


@functools.cache
def closed_loop(seed: int) -> Recording:
    """Two seconds of Model 2 under position control with exact stick and slip, as its sensors see it."""
    motion = simulate_closed_loop(
        HARMONIC,
        PositionController(),
        position_reference(),
        np.arange(1000) / 500,
        torque_noise=TORQUE_NOISE,
        seed=seed,
    )
    return SENSORS.measure(motion, seed)


@functools.cache
def rigid(seed: int = 0) -> Recording:
    """Three seconds of a rigid joint with offset, driven by a multisine whose measurement is noisy."""
    rng = np.random.default_rng(seed)
    time = np.arange(900) / 300
    torque = multisine(time, 25.0, (0.5, 1.3, 2.1, 3.7), seed=5)
    motion = simulate(RIGID, time, {"torque": torque + 0.05 * rng.standard_normal(900)}, RIGID_TRUTH)
    measured = Sensors(noise={"link_position": 1e-5}).measure(motion, seed, keep=("link_position",))
    return measured.with_channels({"torque": torque})


def errors(estimate, truth) -> dict[str, float]:
    """Errors over their standard deviation."""
    return {n: (estimate[n].value - truth[n]) / estimate[n].std_dev for n in estimate.free}
