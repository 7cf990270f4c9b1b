"""The elbow of the emulated robot along a trajectory, as its controller reports it."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.robots import HOME, build_joints
from joint_id_core.simulation.minimum_jerk import minimum_jerk

ELBOW = 2
AT_HOME = HOME[ELBOW]
TRUTH = build_joints("ur3e")[ELBOW].values
GAINS = {name: TRUTH[name] for name in ("k_t", "N")}


def in_moves(points: list[float], seconds: float) -> Trajectory:
    """Moves of least jerk from point to point in rad, from home on, each of so many seconds, without a pause."""
    ends = [AT_HOME, *points]
    s = np.linspace(0.0, 1.0, round(seconds * 500), endpoint=False)
    shape = np.array([*minimum_jerk(s), 60 * s * (1 - s) * (1 - 2 * s)]) / np.array([[1.0], [seconds], [seconds**2]])
    moves = [
        np.array([[start], [0.0], [0.0]]) + (end - start) * shape for start, end in zip(ends, points, strict=False)
    ]
    q, dq, ddq = np.hstack([*moves, [[points[-1]], [0.0], [0.0]]])[:, :, None]
    return Trajectory(("elbow_joint",), np.arange(len(q)) / 500.0, q, dq, ddq)


def along(trajectory: Trajectory, seconds: float, seed: int = 0) -> Recording:
    """The first seconds of a recording, from the begin of the trajectory on."""
    controller, rows = Controller(build_joints("ur3e"), (), 0.3, (5, 13, 0, 0), seed=seed), []
    begin = controller.follow(trajectory)
    while (time := controller.ticks * 0.002) < begin + seconds:
        controller.tick()
        controller.report()
        if time >= begin:
            v = controller.values
            rows.append([time, *(v[name][ELBOW] for name in ("actual_q", "actual_qd", "actual_current"))])
        controller.advance()
    time, link, motor, current = np.array(rows).T
    channels = {"link_position": link, "motor_velocity": TRUTH["N"] * motor, "current": current}
    return Recording(time, channels, source="emulated")
