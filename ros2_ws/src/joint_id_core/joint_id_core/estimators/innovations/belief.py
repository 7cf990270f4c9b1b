"""Gaussian prior of the free parameters, in estimation coordinates.

Coordinates z are the logarithm of positive parameters and the plain value of the others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate


class Coordinates:
    """Maps between physical values of the free parameters and z, and keeps z within the bounds.

    `priors` are standard deviations by parameter that replace the spreads of the model's table, in the same units.
    """

    def __init__(self, model: Model, free: tuple[str, ...], priors: Mapping[str, float] | None = None) -> None:
        rows = {row.name: row for row in model.parameters}
        table = [
            (
                row.positive,
                _logarithm(row.lower) if row.positive else row.lower,
                _logarithm(row.upper) if row.positive else row.upper,
                priors.get(row.name, row.spread) if priors else row.spread,
            )
            for row in (rows[name] for name in free)
        ]
        self.groups = tuple(rows[name].group for name in free)
        positive, self.lower, self.upper, self.spread = np.array(table).T.copy()
        self.positive = positive > 0.0
        self.logarithm = self.positive.astype(float)  # the same for compiled functions
        self._all_positive = bool(self.positive.all())
        self.unit = np.where(self.positive, 1.0, self.spread)  # unit of a step: a factor e, or one spread

    def z(self, values: Array) -> Array:
        """Return the coordinates of physical values, shape (k,)."""
        return np.where(self.positive, np.log(np.where(self.positive, values, 1.0)), values)

    def values(self, z: Array) -> Array:
        """Return the physical values of coordinates, shape (k,)."""
        if self._all_positive:
            return np.exp(z)
        return np.where(self.positive, np.exp(np.where(self.positive, z, 0.0)), z)

    def slope(self, z: Array) -> Array:
        """Return d value / d z, shape (k,)."""
        return self.slope_at(self.values(z))

    def slope_at(self, values: Array) -> Array:
        """Return the same at physical values, shape (k,)."""
        return values if self._all_positive else np.where(self.positive, values, 1.0)

    def clip(self, z: Array) -> Array:
        """Return the nearest point within the bounds."""
        return np.clip(z, self.lower, self.upper)

    def at_bound(self, z: Array) -> NDArray[np.bool_]:
        """Return True for each coordinate that lies on a bound."""
        return (z <= self.lower) | (z >= self.upper)

    def held(self, z: Array, g: Array) -> NDArray[np.bool_]:
        """Return True for each coordinate that lies on a bound and would cross it in direction g."""
        return ((z <= self.lower) & (g < 0.0)) | ((z >= self.upper) & (g > 0.0))


def _logarithm(bound: float) -> float:
    """Return the logarithm of a bound of a positive parameter; -inf for a bound of zero."""
    return math.log(bound) if bound > 0.0 else -math.inf


@dataclass(frozen=True)
class Belief:
    """A Gaussian prior of the parameters `names`: mean (k,) and precision (k, k) in estimation coordinates."""

    names: tuple[str, ...]
    mean: Array
    precision: Array

    @classmethod
    def before_data(cls, data: FitData, coordinates: Coordinates) -> Belief:
        """Return the prior from the start values and the spreads of the coordinates."""
        start = [data.p[data.model.parameter_names.index(n)] for n in data.free]
        return cls(data.free, coordinates.z(np.array(start)), np.diag(np.power(coordinates.spread, -2.0)))

    @classmethod
    def after(cls, estimate: Estimate, coordinates: Coordinates, inflation: float = 1.0) -> Belief:
        """Return an estimate as the prior for later data, with its covariance times `inflation` (forgetting)."""
        values = estimate.values
        z = coordinates.z(np.array([values[n] for n in estimate.free]))
        scale = 1.0 / coordinates.slope(z)
        covariance = estimate.covariance * np.outer(scale, scale) * inflation
        return cls(estimate.free, z, np.asarray(np.linalg.inv(covariance), dtype=float))
