"""Whether parts of a recording ask for the same values, and intervals that contain it if they do not.

A load that is picked up, friction that warms, a push by hand, or a term that the model lacks: each pulls the values in
one part of a recording and not in another one. The score of a correct model is a sum of independent pieces, so the pull
of `BLOCKS` parts scatters as the information says. Source: tests of parameter constancy, Nyblom, J. Am. Stat. Assoc. 84
(1989); covariance from the scores of clusters, Liang and Zeger, Biometrika 73 (1986).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.filtered import run_through
from joint_id_core.estimators.shared.fit_data import FitData, prepare
from joint_id_core.estimators.shared.intervals import with_covariance
from joint_id_core.estimators.shared.sentences import of_halves, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

BLOCKS = 8
CHANCE = 1e-3  # of a correct model that one of its parameters seems to scatter, or to differ between the halves
SIGNIFICANT = 5.0  # standard deviations between the halves from which the user is told


@dataclass(frozen=True)
class Pull:
    """How parts of a recording pull the values, in estimation coordinates; arrays of shape (free,).

    Attributes:
        expected: standard deviation of the estimate by the information of the whole recording.
        scatter: the same by the scatter of the blocks; 0 where that is no more than chance.
        halves: half of the difference between both halves of the recording; its standard deviation is `expected`.
        differs: whether that is more than chance.
    """

    expected: Array
    scatter: Array
    halves: Array
    differs: Array

    def wider(self, sigma: Array) -> Array:
        """Return standard deviations `sigma`, shape (free,), that contain it.

        The scatter of the blocks is a measurement of what `sigma` should be. A value that changes is no scatter.
        """
        changes = np.where(self.differs, self.halves, 0.0)
        return np.asarray(np.sqrt(np.maximum(sigma, self.scatter) ** 2 + changes**2))


def with_constancy(
    estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings | None
) -> Estimate:
    """Return an estimate whose intervals contain that parts of the recording ask for other values.

    Args:
        estimate: by `Innovations`; one that is not converged stays as it is.
        model, recording, settings: what was fitted.
    """
    if not estimate.converged or not estimate.free:
        return estimate
    data = prepare(model, recording, ParameterSettings.of_estimate(estimate), leave_out_rests=True)
    coordinates = Coordinates(model, data.free, (settings or ParameterSettings()).priors)
    found = pull_of(data, coordinates, estimate)
    if found is None:
        return estimate
    slope = coordinates.slope_at(np.array([estimate.values[n] for n in estimate.free]))
    before = np.sqrt(np.diag(estimate.covariance))
    after = slope * found.wider(before / slope)
    scale = after / before
    wider = with_covariance(model, estimate, estimate.covariance * np.outer(scale, scale))
    if wider is estimate or not (told := _told(estimate, found, slope)):
        return wider
    notes = (*estimate.notes[:1], sentence(told), *estimate.notes[1:])
    return wider.noted(notes)


def pull_of(data: FitData, coordinates: Coordinates, estimate: Estimate) -> Pull | None:
    """Return how parts of the data pull the values of an estimate; None if the filter does not run at these values."""
    kernel = compile_model(data.model, "tanh", data.freed, estimate.cell)
    recursion, last = run_through(data, kernel, estimate.noise, estimate.substeps)
    if not np.isfinite(last.cost):
        return None
    slope = coordinates.slope_at(last.free)
    told = np.flatnonzero(np.isfinite(last.variances).all(axis=1) & data.present.any(axis=1))
    if len(told) < BLOCKS:
        return None
    edges = told[np.linspace(0, len(told), BLOCKS, endpoint=False).astype(np.int64)]
    edges[0] = 0
    scores = np.add.reduceat(recursion.scores(last) * slope, edges, axis=0)
    scores -= scores.mean(axis=0)  # it is zero at the minimum; corrections moved the estimate away from there
    shares = np.array([part * np.outer(slope, slope) for part in recursion.information(last, edges)])
    information = shares.sum(axis=0)
    inverse = np.linalg.pinv(information + np.diag(coordinates.spread**-2.0), hermitian=True)
    pulls = scores @ inverse
    variances = np.einsum("ij,kjl,li->ki", inverse, shares, inverse)
    expected = np.maximum(variances.sum(axis=0), 0.0)  # of a parameter that nothing shows, rounding is left
    scatter = (pulls**2).sum(axis=0) * BLOCKS / (BLOCKS - 1)
    # Blocks that tell more than others count for more: so many degrees of freedom has the scatter.
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.maximum(expected**2 / (variances**2).sum(axis=0) - 1.0, 1.0)
        more = scatter / expected > chdtri(freedom, CHANCE) / freedom
        halves = pulls[: BLOCKS // 2].sum(axis=0) - pulls[BLOCKS // 2 :].sum(axis=0)
        differs = halves**2 / expected > chdtri(1.0, CHANCE)
    return Pull(np.sqrt(expected), np.where(more, np.sqrt(scatter), 0.0), halves, differs)


def _told(estimate: Estimate, found: Pull, slope: Array) -> str:
    """Return in words which parameters differ most between the halves of the recording; empty if none does."""
    size = np.where(found.differs, np.abs(found.halves) / found.expected, 0.0)
    shown = [k for k in np.argsort(-size)[:2] if size[k] > SIGNIFICANT]
    if not shown:
        return ""
    values = estimate.values
    apart = {estimate.free[k]: float(found.halves[k] * slope[k]) for k in shown}
    return of_halves((name, values[name] + half, values[name] - half) for name, half in apart.items())
