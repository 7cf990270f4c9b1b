"""How far the truth may be from what a memory says because the memory is linear.

A memory holds what its samples say near the parameters at which they passed the filter. Some combinations of parameters
may be known to 5 % only, such as the scale of all torques and inertias, and others to 0.1 %. Along the first ones, the
truth is so far away that the others bend by many of their standard deviations. While all samples are of one joint this
does no harm: the first ones make every interval wide. But after a change of the load another combination is hardly
known, and both together seem to fix the scale, at a wrong value. So before what is known is used for another joint, its
covariance takes the bend: the second-order term of its expansion, as in a second-order filter (Bass, Norum & Schwartz,
Journal of Mathematical Analysis and Applications 16, 1966).
"""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.memory import Memory
from joint_id_core.online.symmetric import solve
from joint_id_core.online.tracker import Tracker

LINEAR = 0.02  # standard deviation of a combination of coordinates up to which the bend is negligible
FARTHEST = 0.5  # longest step along a combination, by which the bend is measured
NOTHING = 10.0  # bend from which nothing is known any more: a factor e^10, or ten times the spread


def curvature(tracker: Tracker, memory: Memory, coordinates: Coordinates, memory_s: float) -> Array:
    """Return the second-order part of the covariance of a memory, shape (k, k).

    The blocks of the memory pass the filter again, one standard deviation to either side along each combination that is
    hardly known, and there take a Gauss-Newton step across it. If s is the normal distance along the combination, the
    truth is off by s^2 times this step, whose mean square is three times its square.

    The filter then stands somewhere else.
    """
    unit, covariance, mean = coordinates.unit, memory.covariance, memory.mean
    found = np.zeros_like(covariance)
    if not memory.blocks:
        return found
    variances, axes = np.linalg.eigh(covariance / np.outer(unit, unit))
    for k in np.flatnonzero(variances > LINEAR**2):
        sigma = np.sqrt(variances[k])
        length = min(1.0, FARTHEST / sigma)  # in standard deviations
        along = unit * axes[:, k] * sigma
        across = solve(covariance, along)
        for z in (coordinates.clip(mean + by * length * along) for by in (1.0, -1.0)):
            passed = tracker.again(memory.blocks, z)
            if passed is None:
                continue
            there = memory.copy()
            there.replace(passed[1], memory_s)
            step, normal = solve(there.matrix, np.column_stack([there.vector - there.matrix @ z, across])).T
            step = (step - normal * (across @ step) / (across @ normal)) / length**2
            if np.isfinite(step).all():
                step = np.clip(step, -NOTHING * unit, NOTHING * unit)
                found += 1.5 * np.outer(step, step)  # the mean of both sides
    return found
