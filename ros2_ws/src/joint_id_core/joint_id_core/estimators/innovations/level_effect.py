"""Measures how the noise levels of a record, which are estimates as well, act on the intervals of its parameters."""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum
from joint_id_core.estimators.innovations.noise import covariance_of_levels
from joint_id_core.results.level_effect import LevelEffect

KNOWN = 0.1  # standard deviation of the logarithm of a variance up to which its effect is left out
HIDDEN = 1.0  # information on the logarithm of a variance below which a record only limits it
ALIKE = 0.9  # correlation of what a record says of two levels from which one of them stands for both
COARSE = 4.0  # factor between the variances that are tried for a hidden level
ENOUGH = 0.01  # weight over the largest one from which larger variances make no difference,
MOST = 12  # and their largest number


def effect_of_levels(cost: Cost, found: Minimum, information: Array) -> LevelEffect:
    """Measure the effect at the latest point of a fit, with further passes for levels that are not well known.

    `information` (L, L) is that of the record on the logarithms of the levels.
    """
    last, z = found.last, cost.coordinates.z(found.last.free)
    here, shown = cost.after(z, last, found.substeps), np.diag(information)
    slopes, hidden, score = np.zeros((len(z), len(shown))), np.zeros((len(z), len(shown))), np.zeros(len(shown))
    if here is not None and here.definite:
        at = _Levels(cost, here)
        sigma = np.sqrt(np.diag(covariance_of_levels(information)))
        stands = shown >= HIDDEN
        for k in np.flatnonzero(sigma > KNOWN).tolist():
            if shown[k] >= HIDDEN:
                other = at.other(k, last.levels[k] * math.exp(sigma[k]))
                if other is not None:
                    slopes[:, k] = at.variances(other) / sigma[k]
                    score[k] = -0.5 * at.information(other) / sigma[k]
            elif not np.any(stands & (information[k] ** 2 > ALIKE**2 * shown[k] * shown)):
                stands[k] = True
                hidden[:, k] = at.limited(k, last.levels[k] / math.sqrt(max(shown[k], 1e-16)))
    return LevelEffect(slopes, score, hidden, shown)


class _Levels:
    """Passes with other noise levels than those of a point."""

    def __init__(self, cost: Cost, here: Minimum) -> None:
        self._cost, self._here = cost, here

    def other(self, k: int, variance: float) -> Minimum | None:
        """Return the point with another level; None if its matrix cannot be used."""
        levels, here = self._here.levels.copy(), self._here
        levels[k] = variance
        found = self._cost.at(here.z, levels, here.last.steps, here.substeps)
        return found if found is not None and found.definite else None

    def variances(self, other: Minimum) -> Array:
        """Return how much larger the logarithms of the variances of the coordinates are there, shape (k,)."""
        return np.asarray(np.log(np.diag(other.inverse) / np.diag(self._here.inverse)))

    def information(self, other: Minimum) -> float:
        """Return how much larger the logarithm of the determinant of the information is there."""
        return float(np.linalg.slogdet(other.hessian)[1] - np.linalg.slogdet(self._here.hessian)[1])

    def limited(self, k: int, variance: float) -> Array:
        """Return the logarithms of the factors (k,) for a level that the record shows from about `variance` on."""
        weights, total = [0.0], np.zeros_like(self._here.z)
        variance /= COARSE
        for _ in range(MOST):
            other = self.other(k, variance)
            if other is None:
                break
            worse = other.cost - self._here.cost + self.information(other)
            weights.append(math.exp(-0.5 * min(max(worse, -100.0), 1000.0)) * math.sqrt(variance))
            total += weights[-1] * np.exp(0.5 * self.variances(other))
            if weights[-1] < ENOUGH * max(weights):
                break
            variance *= COARSE
        return np.asarray(np.log(np.maximum(1.0, total / max(sum(weights), 1e-300))))
