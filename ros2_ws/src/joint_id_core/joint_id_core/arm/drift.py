"""How far friction changes from one stretch of motion to the next, which the memory of residuals does not tell.

Friction of real gears changes with temperature, with the place of the teeth, and over days. Every stretch gives its own
friction beside that of the whole; as far as these scatter more than their variances, friction drifts: a random effect,
its variance by the moments of DerSimonian & Laird (Controlled Clinical Trials 7, 1986). It is taken as the same share
of the friction of every joint: one joint alone tells too little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.stacked import Stacked, centred, solved
from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.covariance import newey_west

STRETCH = 200  # equations of a stretch: ten seconds of motion
LEAST = 40  # equations, less tell nothing
DEPENDENT = 1e-3  # least share of its square by which a column differs from the other one


def drift(table: Stacked, left: Array, columns: NDArray[np.intp], friction: Array, lag: float) -> Array:
    """Return the standard deviation of the drift of kinds of friction, as shares of their values, (k,).

    Args:
        table: of the fit.
        left: torques that it leaves, (T,).
        columns: places of the parameters by kind and joint, (k, n).
        friction: their values, (k, n).
        lag: in equations, over which what is left remembers.
    """
    kinds, count = columns.shape
    spread, freedom, weight = np.zeros(kinds), np.zeros(kinds), np.zeros(kinds)
    for j in range(count):
        stretches = (
            _of_stretch(table.columns[np.ix_(rows, columns[:, j])], left[rows], lag) for rows in _stretches(table, j)
        )
        found = [pair for pair in stretches if pair is not None]
        if len(found) < 2:
            continue
        values = np.array([v for v, _ in found]) / friction[:, j]
        weights = friction[:, j] ** 2 / np.array([s for _, s in found])
        mean = (weights * values).sum(axis=0) / weights.sum(axis=0)
        spread += (weights * (values - mean) ** 2).sum(axis=0)
        freedom += len(found) - 1
        weight += weights.sum(axis=0) - (weights**2).sum(axis=0) / weights.sum(axis=0)
    variance = np.divide(spread - freedom, weight, out=np.zeros(kinds), where=weight > 0.0)
    return np.asarray(np.sqrt(np.maximum(0.0, variance)))


def _stretches(table: Stacked, joint: int) -> list[NDArray[np.intp]]:
    """Return the rows of the stretches of a joint, at least two of each recording."""
    own = np.flatnonzero(table.joint == joint)
    found: list[NDArray[np.intp]] = []
    for piece in np.unique(table.pieces[own]):
        rows = own[table.pieces[own] == piece]
        found += np.array_split(rows, max(2, round(len(rows) / STRETCH)))
    return [rows for rows in found if len(rows) >= LEAST]


def _of_stretch(columns: Array, left: Array, lag: float) -> tuple[Array, Array] | None:
    """Return values and their variances, each (k,), of a stretch by itself; None if it cannot tell them apart."""
    own, y = centred(columns), centred(left)
    size = np.linalg.norm(own, axis=0)
    if not size.all() or np.linalg.det((own / size).T @ (own / size)) < DEPENDENT:
        return None
    values = solved(own, y)
    covariance = newey_west(own, y - own @ values, np.zeros(len(y), dtype=np.int64), lag)
    variances = np.diag(covariance)
    return (values, variances) if np.all(variances > 0.0) else None
