"""Loop over time of a joint under a sampled position controller, compiled like `loops.simulate`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from joint_id_core.cell.loops.arrays import Indices, Matrix, Vector

NX: int  # states
NC: int  # parameter-only constants
constants: Callable[..., None]
step: Callable[..., None]


def follow(
    x0: Vector,
    time: Vector,
    q: Vector,
    dq: Vector,
    gains: Vector,
    at: Indices,
    slow: Vector,
    p: Vector,
    few: int,
    many: int,
    u: Matrix,
    X: Matrix,
) -> None:
    """Simulate a joint that follows a reference q, dq (T) of its link, as `simulation.position_control` does.

    Inputs:
        x0 (NX): start state.
        time (T), q (T), dq (T): instants in s, positions and velocities of the reference.
        gains: k_p, k_d and limit of the controller's torque, its torque for a unit of the drive, and the velocity of
            the link for a unit of the state that the controller takes it from.
        at: indices of the drive among the inputs, and of link position and that velocity among the states.
        slow (NX): size of a state below which smoothed friction is stiff, 0 for states without friction.
        few, many: integrator steps of a sample; many where a state is slow, or may become so within the sample.

    Outputs:
        u (T, NU): receives the drive, and holds the other inputs.
        X (T, NX): states.
    """
    c = np.empty(NC)
    constants(p, c)
    x = np.empty(NX)
    for i in range(NX):
        x[i] = x0[i]
    for t in range(len(time)):
        stiff = 0.0
        for i in range(NX):
            X[t, i] = x[i]
            moved = abs(x[i] - X[t - 1, i]) if t > 0 else 0.0
            if slow[i] > 0.0 and abs(x[i]) < slow[i] + 1.2 * moved:
                stiff = 1.0
        wanted = gains[0] * (q[t] - x[at[1]]) + gains[1] * (dq[t] - gains[4] * x[at[2]])
        u[t, at[0]] = max(-gains[2], min(gains[2], wanted)) / gains[3]
        if t < len(time) - 1:
            step(x, x, u[t], u[t], c, time[t + 1] - time[t], many if stiff > 0.0 else few)
