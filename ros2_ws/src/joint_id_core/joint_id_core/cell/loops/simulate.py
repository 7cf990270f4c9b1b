"""The loops over time of a simulation around one compiled step.

What follows the mark is never called: `cell.kernel` puts its text behind the generated functions of a model and
compiles both together, which is why those and the sizes are only declared here. The work space V of the sensitivities
is one array on the stack: rows, `columns` apart, NX of which are W, the derivatives of the state, then the step's own.
Its columns are the derivatives by the NP parameters, in `step_full` then by the NX states at the start of the sample
and the NU inputs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

NX: int  # states
NW: int  # rows of the work space V
NP: int  # parameters with sensitivities
NC: int  # parameter-only constants
CP: int  # columns of the work space of `step_parameters`
SP: int  # its numbers
carray: Callable[..., Any]  # of numba
on_stack: Callable[[int], Any]
constants: Callable[..., None]
jacobian: Callable[..., None]
step: Callable[..., None]
step_parameters: Callable[..., None]


ALIGN = 8  # numbers in a cache line


def padded(columns: int) -> int:
    """Columns of a row that ends with a cache line."""
    return max(ALIGN, -(-columns // ALIGN) * ALIGN)


# --- compiled from here ---


def rollout(X0: Any, block: int, time: Any, u: Any, p: Any, substeps: Any, X: Any) -> None:
    """Simulate, begun anew every `block` samples from the next row of X0 (B, NX).

    substeps (T): steps from each sample to the next. X (T, NX) receives the states; where a run begins anew, those
    at the end of the one before.
    """
    c = np.empty(NC)
    constants(p, c)
    x = X0[0].copy()
    for t in range(len(time)):
        for i in range(NX):  # of slices the compiler makes text for errors, which takes it two seconds
            X[t, i] = x[i]
            if t % block == 0:
                x[i] = X0[t // block, i]
        if t < len(time) - 1:
            step(x, x, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t])


def rollout_sensitivities(x0: Any, time: Any, u: Any, p: Any, substeps: Any, X: Any, J: Any) -> None:
    """Simulate from x0 with the derivatives of all states by p, J (T, NX, NP)."""
    c = np.empty(NC)
    constants(p, c)
    x = x0.copy()
    V = carray(on_stack(SP), SP)
    for j in range(SP):
        V[j] = 0.0
    for t in range(len(time)):
        for i in range(NX):
            X[t, i] = x[i]
            for j in range(NP):
                J[t, i, j] = V[i * CP + j]
        if t < len(time) - 1:
            step_parameters(x, V, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t])


def jacobians(X: Any, u: Any, p: Any, A: Any) -> None:
    """df/dx at every row of X (T, NX), u (T, NU), into A (T, NX, NX)."""
    c = np.empty(NC)
    constants(p, c)
    for t in range(len(X)):
        jacobian(X[t], u[t], c, A[t])
