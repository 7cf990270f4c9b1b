"""Coulomb friction of many elements that act on each other: which of them stick, in one step of time.

Time stepping with the impulses of friction as unknowns (Moreau 1988; Stewart & Trinkle 1996): a linear complementarity
problem whose matrix is positive definite. It is solved by block pivoting, which ends in single pivots by the least
index if the blocks run in circles (Judice & Pires, Computers & Operations Research 21, 1994).
"""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError

_BLOCKS, _MOST = 10, 1000  # attempts that change all that is wrong, and attempts at all
_EXCESS = 1e-12  # of the largest static friction, by rounding


def with_friction(matrix: Array, impulse: Array, limit: Array, modes: Array) -> tuple[Array, Array]:
    """Return the velocities v at the end of a step, with matrix v + limit sgn(v) = impulse, and the modes.

    Where v = 0, friction takes any value up to its limit.

    Args:
        matrix: positive definite, shape (n, n).
        impulse: of all forces but friction, shape (n,).
        limit: largest impulse of friction, shape (n,).
        modes: +1 or -1 for an element that slides, 0 for one that sticks, as they were before the step, shape (n,).

    Raises:
        JointIdError: an impulse that is not finite, or no solution.
    """
    if not np.isfinite(impulse).all():
        raise JointIdError("an impulse is not finite: check forces and parameters")
    for attempt in range(_MOST):
        sliding = modes != 0.0
        if sliding.all():
            velocity = np.asarray(np.linalg.solve(matrix, impulse - limit * modes), dtype=float)
            wrong = velocity * modes < 0.0
            away = modes
        else:
            some = np.flatnonzero(sliding)
            velocity = np.zeros(len(modes))
            velocity[some] = np.linalg.solve(matrix[some][:, some], (impulse - limit * modes)[some])
            away = impulse - matrix @ velocity
            wrong = np.where(sliding, velocity * modes < 0.0, np.abs(away) > limit * (1.0 + _EXCESS))
        if not wrong.any():
            return velocity, modes
        if attempt >= _BLOCKS:
            wrong[np.argmax(wrong) + 1 :] = False
        modes = np.where(wrong, np.where(sliding, 0.0, np.sign(away)), modes)
    raise JointIdError("the friction of the joints has no solution: check their parameters")
