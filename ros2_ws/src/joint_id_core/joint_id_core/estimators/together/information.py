"""What several recordings say of their common parameters, added as information.

A posterior without its prior is what the data alone say (Bayes; Gelman et al., Bayesian Data Analysis, 3rd ed., ch. 5).
Parameters that belong to a recording, such as offsets, are left out of the sum. Where recordings scatter by more than
their intervals, the intervals are widened by the ratio (Birge, Physical Review 40, 1932).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.shared.intervals import WIDTH
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.results.verdict import PRIOR_RATIO

FAR = 3.0  # standard deviations between a recording and all from which they disagree
TINY = 1e-12  # sum of weights that is rounding
OWN = 0.1  # least share of its own variance by which a recording differs from a sum that holds it


class Space:
    """Coordinates of the common parameters, with the mean (k,) and the precision (k, k) of the prior."""

    def __init__(self, model: Model, estimate: Estimate, settings: ParameterSettings) -> None:
        self.names = tuple(n for n in estimate.free if not model.parameter(n).of_recording)
        bayes = estimate.estimator == Innovations.name
        coordinates = Coordinates(model, self.names, settings.priors)
        self.positive = np.array([model.parameter(n).positive for n in self.names])
        self.log = self.positive & bayes
        self.spread = coordinates.spread if bayes else np.full(len(self.names), np.inf)
        start, _ = settings.applied_to(model)
        values = np.array([start[model.parameter_names.index(n)] for n in self.names])
        self.mean, self.precision = self.z(values), np.diag(self.spread**-2.0)

    def z(self, values: Array) -> Array:
        """Return the coordinates of physical values, shape (k,)."""
        return np.where(self.log, np.log(np.where(self.log, values, 1.0)), values)

    def values(self, z: Array) -> Array:
        """Return the physical values of coordinates, shape (k,)."""
        return np.where(self.log, np.exp(np.where(self.log, z, 0.0)), z)

    def slope(self, z: Array) -> Array:
        """Return d value / d z, shape (k,)."""
        return np.where(self.log, self.values(z), 1.0)


@dataclass(frozen=True)
class Share:
    """What one recording says of the common parameters.

    Attributes:
        z: coordinates, shape (k,).
        covariance, excess: of z, and the part of it that stands for what the model lacks, shapes (k, k).
        information: of the data alone, without the prior, shape (k, k); zero for unknown parameters.
        known: True for parameters that it knows, shape (k,).
    """

    z: Array
    covariance: Array
    excess: Array
    information: Array
    known: NDArray[np.bool_]


def share_of(space: Space, estimate: Estimate) -> Share:
    """Return what the data of one recording say; its own parameters are unknown to the others, so they are left out."""
    index = [estimate.free.index(n) for n in space.names]
    z = space.z(np.array([estimate[n].value for n in space.names]))
    slope = space.slope(z)
    covariance = estimate.covariance[np.ix_(index, index)] / np.outer(slope, slope)
    known = np.isfinite([estimate[n].std_dev for n in space.names]) & (np.diag(covariance) > 0.0)
    excess = np.zeros_like(covariance)
    if estimate.checks is not None and estimate.status is Status.CONVERGED:
        excess = estimate.checks.excess[np.ix_(index, index)]
    information = np.zeros_like(covariance)
    if known.any():
        some = np.ix_(known, known)
        size = np.sqrt(np.diag(covariance[some]))  # of the coordinates, whose units differ by many decades
        units = np.outer(size, size)
        without = (covariance[some] - excess[some]) / units
        if np.linalg.eigvalsh(without).min() <= 0.0:
            without, excess = covariance[some] / units, np.zeros_like(excess)
        values, vectors = np.linalg.eigh(np.linalg.inv(without) - space.precision[some] * units)
        information[some] = (vectors * np.maximum(values, 0.0)) @ vectors.T / units
    return Share(z, covariance, excess, information, known)


def added(space: Space, shares: Sequence[Share]) -> tuple[Array, Array]:
    """Return z (k,) and covariance (k, k) of all; what no recording shows stays at the prior."""
    total = space.precision + sum(share.information for share in shares)
    vector = space.precision @ space.mean + sum(share.information @ share.z for share in shares)
    unseen = ~np.any([share.known for share in shares], axis=0) & (np.diag(space.precision) == 0.0)
    size = np.sqrt(np.where(unseen, 1.0, np.diag(total)))
    inverse = np.linalg.inv(total / np.outer(size, size) + np.diag(np.where(unseen, 1.0, 0.0))) / np.outer(size, size)
    z = np.where(unseen, space.mean, inverse @ vector)
    z = np.where(space.positive & ~space.log, np.maximum(z, 0.0), z)
    # What the model lacks is the same in all recordings: it does not average out.
    weights = [float(np.trace(inverse @ share.information)) for share in shares]
    excess = sum(w * share.excess for w, share in zip(weights, shares, strict=True)) / max(sum(weights), TINY)
    covariance = inverse + excess
    covariance[unseen, unseen] = np.inf
    return z, covariance


def scatter(
    space: Space, shares: Sequence[Share], z: Array, covariance: Array
) -> tuple[Array, Array, list[Array]]:  # fmt: skip
    """Return z (k,), by how much its intervals are to be wider, at least 1, and how far recordings are from the sum.

    Where recordings disagree, correlated parameters may put the sum far from all of them: then z is the mean of what
    they say of each parameter by itself, and the interval holds each that is far from the sum.

    Args:
        space, shares: of the recordings.
        z, covariance: of the sum, shapes (k,) and (k, k).
    """
    variance, values = np.diag(covariance), np.array([share.z for share in shares])
    own = np.array([np.diag(share.covariance) for share in shares])
    says = np.array([share.known for share in shares]) & (own < (PRIOR_RATIO * space.spread) ** 2)
    says &= np.isfinite(variance)
    # The sum holds the recording itself: its distance from the sum varies less than its value.
    rest = np.where(says, np.maximum(own - variance, OWN * own), 1.0)
    distances = np.where(says, (values - z) / np.sqrt(rest), np.nan)
    far = np.abs(distances) > FAR  # False for NaN
    weights = np.where(says & far.any(), 1.0 / np.where(says, own, 1.0), 0.0)
    total = weights.sum(axis=0)
    z = np.where(total > 0.0, (weights * values).sum(axis=0) / np.where(total > 0.0, total, 1.0), z)
    off = np.maximum(np.abs(values - z), np.abs(space.values(values) - space.values(z)) / space.slope(z))
    least = np.maximum(np.where(far, off, 0.0).max(axis=0) / WIDTH, np.where(total > 0.0, total, np.inf) ** -0.5)
    holding = least / np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    squares = np.sum(np.where(says, (values - z) ** 2 / np.where(says, own, 1.0), 0.0), axis=0)
    counts = np.count_nonzero(says, axis=0)
    ratio = np.where(counts > 1, np.sqrt(squares / np.maximum(counts - 1.0, 1.0)), 1.0)
    return z, np.maximum(np.maximum(1.0, holding), ratio), list(distances)
