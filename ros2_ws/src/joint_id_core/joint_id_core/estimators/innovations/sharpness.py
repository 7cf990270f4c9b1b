"""Bias from the smoothing of Coulomb friction, as far as the data allow for sharper friction.

A fit smooths the step of friction; a joint sticks. Sharper friction would move the estimates, and the data tell how
likely it is. The square of the move, times that probability, belongs to the covariance, as in model averaging
(Buckland, Burnham & Augustin, Biometrics 53, 1997).
"""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum
from joint_id_core.estimators.innovations.stages import Stages
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.substeps import steps_of

# The bias is about proportional to the smoothing velocity, so a fourth of it moves the estimates by three quarters of
# their bias. With an eighth the move is no longer linear: single records move by ten times as much.
SHARPER = 4.0
# Part of the noise of a label that is rounding, from which the likelihood does not tell smooth friction from sharp:
# while a joint sticks, rounding is the same in many samples, and friction that lets it creep seems more likely.
ROUNDED = 0.5
WHOLE = 0.01  # how far the number of steps may be from a whole one


def smoothing_bias(stages: Stages, found: Minimum) -> Array:
    """Return what smoothed friction adds to the covariance of the coordinates, shape (k, k).

    One pass with sharper friction, at the point of the last pass, gives the change of the score; times the inverse of
    the information this is the move of the estimates, at most the spread of the prior. Zero for models without Coulomb
    friction, and where the path with sharper friction diverges.
    """
    data, nothing = stages.data, np.zeros_like(found.hessian)
    index = [data.model.parameter_names.index(name) for name in data.model.smoothing.values()]
    if not index:
        return nothing
    by, sharper = _sharper(stages, found, index)
    if sharper is None:
        return nothing
    move = found.inverse @ (sharper.gradient - found.gradient) * by / (by - 1.0)
    move = np.clip(move, -stages.coordinates.spread, stages.coordinates.spread)
    probability = float(expit(0.5 * (_least(found) - _least(sharper))))  # both were as likely before the data
    if _is_rounded(data, found.last.levels):
        probability = max(probability, 0.5)
    return np.asarray(probability * np.outer(move, move))


def _sharper(stages: Stages, found: Minimum, index: list[int]) -> tuple[float, Minimum | None]:
    """Return the point of the last pass with the smoothing velocities of these indices divided by a factor, and that.

    Where the path diverges, it takes twice as many steps, and then friction that is less sharp; None if all do.
    """
    last, z = found.last, stages.coordinates.z(found.last.free)
    for by in (SHARPER, 0.5 * SHARPER):
        p = stages.data.p.copy()
        p[index] /= by
        recursion = stages.recursion.with_held(p)
        cost = Cost(recursion, stages.coordinates, stages.cost.belief)
        needed = steps_of(recursion.data, stages.kernel, cost.values(z), last.states, found.substeps)
        for more in (1, 2):
            near = cost.at(z, last.levels, more * np.maximum(needed, last.steps), more * found.substeps)
            if near is not None and near.definite:
                return by, near
    return SHARPER, None


def _is_rounded(data: FitData, levels: Array) -> bool:
    """Return whether most of the noise of a label is rounding; `levels` (labels + inputs,) are variances."""
    rows = zip(data.rows, levels.tolist(), strict=False)
    return any(_step(row) ** 2 / 12.0 > ROUNDED * level for row, level in rows)


def _step(row: Array) -> float:
    """Return the step of which all changes of a signal are multiples; 0 if there is none."""
    changes = np.abs(row[1:] - row[:-1])
    changes = changes[changes > 0.0]
    if not len(changes):
        return 0.0
    step = float(changes.min())
    return step if np.all(np.abs(changes / step - np.rint(changes / step)) < WHOLE) else 0.0


def _least(near: Minimum) -> float:
    """Return the cost at the minimum that the last pass foresees."""
    return near.cost - float(near.gradient @ near.inverse @ near.gradient)
