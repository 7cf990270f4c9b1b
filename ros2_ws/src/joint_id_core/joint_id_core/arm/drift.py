"""How far friction changes from one stretch of motion to the next, which the memory of residuals does not tell.

Friction of real gears changes with temperature, with the place of the teeth, and over days. Every stretch gives its own
friction beside that of the whole; as far as these scatter more than their variances, friction drifts: a random effect,
its variance by the moments of DerSimonian & Laird (Controlled Clinical Trials 7, 1986). It is taken as the same share
of the friction of every joint: one joint alone tells too little.

A variance of a stretch is the larger one of two, as for the whole: in ten seconds residuals hardly show a slow noise,
which would be taken for drift.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.autoregressive import of_products
from joint_id_core.arm.noise import noise_of
from joint_id_core.arm.stacked import Stacked, centred, free, solved
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
        stretches = [
            (centred(table.columns[np.ix_(rows, columns[:, j])]), centred(left[rows])) for rows in _stretches(table, j)
        ]
        stretches = [(own, y) for own, y in stretches if _told_apart(own)]
        if len(stretches) < 2:
            continue
        found = np.array([solved(own, y) for own, y in stretches])
        variances = _variances(stretches, found, lag)
        if not np.all(variances > 0.0):
            continue
        values, weights = found / friction[:, j], friction[:, j] ** 2 / variances
        mean = (weights * values).sum(axis=0) / weights.sum(axis=0)
        spread += (weights * (values - mean) ** 2).sum(axis=0)
        freedom += len(stretches) - 1
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


def _told_apart(own: Array) -> bool:
    """Return whether a stretch can tell its columns (T, k) apart."""
    size = np.linalg.norm(own, axis=0)
    return bool(size.all() and np.linalg.det((own / size).T @ (own / size)) >= DEPENDENT)


def _variances(stretches: Sequence[tuple[Array, Array]], found: Array, lag: float) -> Array:
    """Return the variances of values (S, k) of stretches of a joint, each with columns (T, k) and torques (T,)."""
    residuals = [y - own @ values for (own, y), values in zip(stretches, found, strict=True)]
    noise = noise_of(
        np.concatenate([r / np.sqrt(free(own)) for r, (own, _) in zip(residuals, stretches, strict=True)]), lag
    )
    variances = []
    for (own, _), left in zip(stretches, residuals, strict=True):
        shown = newey_west(own, left, np.zeros(len(left), dtype=np.int64), lag)
        inverse = np.linalg.inv(own.T @ own)
        variances.append(np.maximum(np.diag(shown), np.diag(inverse @ of_products(own, noise) @ inverse)))
    return np.array(variances)
