"""Loops over time of a simulation around one compiled step.

`cell.translate` compiles them for a model. The sizes and functions of the model are only declared here. The work space
V of the sensitivities is one flat array of rows with CP or CF numbers. The first NX rows are W, the derivatives of the
state; the other rows are for the step's own use. The columns are the derivatives by the NP parameters; in `step_full`
the derivatives by the NX states at the start of the sample and by the NU inputs follow.
"""

from __future__ import annotations

import math
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
SQUARINGS = 32  # the 32nd square of a matrix shows its largest eigenvalue to eight digits


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


def spectral_radius(A: Cube) -> float:
    """Return the largest |lambda| of the matrices A (T, NX, NX); infinite if a number in them is not finite.

    By Gelfand's formula, the limit of |A^k|^(1/k), with k = 2^SQUARINGS. Every square is scaled to largest entry 1.
    """
    B, square = np.empty((NX, NX)), np.empty((NX, NX))
    largest = 0.0
    for t in range(len(A)):
        for i in range(NX):
            for j in range(NX):
                B[i, j] = A[t, i, j]
        logarithm, share = 0.0, 1.0
        for _ in range(SQUARINGS):
            size = 0.0
            for i in range(NX):
                for j in range(NX):
                    if not abs(B[i, j]) < math.inf:
                        return math.inf
                    size = max(size, abs(B[i, j]))
            if size == 0.0:  # a power is zero, and so are all eigenvalues
                logarithm = -math.inf
                break
            logarithm += share * math.log(size)
            share *= 0.5
            for i in range(NX):
                for j in range(NX):
                    total = 0.0
                    for k in range(NX):
                        total += (B[i, k] / size) * (B[k, j] / size)
                    square[i, j] = total
            for i in range(NX):
                for j in range(NX):
                    B[i, j] = square[i, j]
        largest = max(largest, math.exp(logarithm))
    return largest
