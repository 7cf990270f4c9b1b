"""Loops over time of a simulation around one compiled step.

`cell.translate` compiles them for a model. The sizes and functions of the model are only declared here. The work space
V of the sensitivities is one flat array of rows with CP or CF numbers. The first NX rows are W, the derivatives of the
state; the other rows are for the step's own use. The columns are the derivatives by the NP parameters; in `step_full`
the derivatives by the NX states at the start of the sample and by the NU inputs follow.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from joint_id_core.cell.loops.arrays import Cube, Indices, Matrix, Vector

NX: int  # states
NW: int  # rows of the work space V
NP: int  # parameters with sensitivities
NC: int  # parameter-only constants
CP: int  # columns of the work space of `step_parameters`
SP: int  # size of this work space
constants: Callable[..., None]
jacobian: Callable[..., None]
step: Callable[..., None]
step_parameters: Callable[..., None]


ALIGN = 8  # numbers in a cache line


def padded(columns: int) -> int:
    """Return the columns of a row, rounded up so that it ends with a cache line."""
    return max(ALIGN, -(-columns // ALIGN) * ALIGN)


def rollout(X0: Matrix, block: int, time: Vector, u: Matrix, p: Vector, substeps: Indices, X: Matrix) -> None:
    """Simulate, with a restart every `block` samples from the next row of X0 (B, NX).

    substeps (T): steps from each sample to the next. X (T, NX) receives the states; at a restart, the last ones of the
    previous run.
    """
    c = np.empty(NC)
    constants(p, c)
    x = np.empty(NX)
    for i in range(NX):
        x[i] = X0[0, i]
    for t in range(len(time)):
        for i in range(NX):
            X[t, i] = x[i]
            if t % block == 0:
                x[i] = X0[t // block, i]
        if t < len(time) - 1:
            step(x, x, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t])


def rollout_sensitivities(
    x0: Vector, time: Vector, u: Matrix, p: Vector, substeps: Indices, X: Matrix, J: Cube
) -> None:
    """Simulate from x0 and fill J (T, NX, NP) with the derivatives of all states by the parameters."""
    c = np.empty(NC)
    constants(p, c)
    x, V = np.empty(NX), np.zeros(SP)
    for i in range(NX):
        x[i] = x0[i]
    for t in range(len(time)):
        for i in range(NX):
            X[t, i] = x[i]
            for j in range(NP):
                J[t, i, j] = V[i * CP + j]
        if t < len(time) - 1:
            step_parameters(x, V, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t])


def jacobians(X: Matrix, u: Matrix, p: Vector, A: Cube) -> None:
    """Fill A (T, NX, NX) with df/dx at every row of X (T, NX) and u (T, NU)."""
    c = np.empty(NC)
    constants(p, c)
    for t in range(len(X)):
        jacobian(X[t], u[t], c, A[t])
