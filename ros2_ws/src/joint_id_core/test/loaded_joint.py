"""A joint of a UR robot under position control, which may pick up a load."""

from __future__ import annotations

import functools

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.plants import MotionOptions, PositionControl
from joint_id_core.simulation.position_control import ControlledJoint, PositionController
from joint_id_core.simulation.sensors import ur_robot_sensors

from .moves import random_moves

RATE = 500  # Hz
SENSORS = ("link_position", "motor_velocity", "current")
INERTIA = "J_q"  # of the link, with what it holds
FACTOR = 2.0  # of the load, on it


def plant() -> PositionControl:
    return PositionControl({}, MotionOptions(), 0)


def loaded(seconds: float, loaded_s: float = np.inf, seed: int = 1) -> Recording:
    """What the sensors of the joint show, which holds the load from an instant in s on."""
    return carrying(seconds, ((min(loaded_s, seconds), FACTOR),), seed)


@functools.cache
def carrying(
    seconds: float, loads: tuple[tuple[float, float], ...], seed: int = 1, moves_seed: int | None = None
) -> Recording:
    """The same with several loads: from instants in s on, the inertia is that of the joint alone times a factor.

    The joint moves along a multisine, or with `moves_seed` from point to point.
    """
    joint, rng = plant(), np.random.default_rng(seed)
    reference = position_reference() if moves_seed is None else random_moves(moves_seed)
    loop = ControlledJoint(joint.model, PositionController(), reference, joint.values)
    at = {round(since * RATE): factor for since, factor in loads}
    sensors, rows = ur_robot_sensors(joint.values["N"]), []
    for k in range(round(seconds * RATE)):
        if k in at:
            loop.change({**joint.values, INERTIA: at[k] * joint.values[INERTIA]})
        row = {**loop.joint.state, **loop.tick(1.0 / RATE)}
        rows.append([float(sensors.reading(name, row[name], rng)) for name in SENSORS])
    return Recording(np.arange(len(rows)) / RATE, dict(zip(SENSORS, np.array(rows).T, strict=True)))
