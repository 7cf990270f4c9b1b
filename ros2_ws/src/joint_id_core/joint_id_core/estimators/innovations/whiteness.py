"""Autocorrelated residuals widen the covariance: noise that is not white, as friction ripple or a drive's filter leave.

Ljung & Box (1978) test each label's residuals over many lags at once. Where they are not white, the scores of the
parameters add up over time, and their sum has another variance than the information matrix says: it is taken from the
data (Newey & West, Econometrica 55, 1987), and the covariance of the estimates is that of the sandwich.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.sentences import times

LAGS = 30  # samples
RARE = 1e-4  # probability of what white residuals show, below which they are called coloured


@dataclass(frozen=True)
class Memory:
    """What the residuals' memory adds to the covariance of the coordinates, (k, k), and how it is told."""

    excess: Array
    text: str


def memory(recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass) -> Memory:
    """Test the residuals of a fit, whose latest pass is `last`; nothing is added where they are white."""
    data = recursion.data
    strength, probability = portmanteau(data, last.residuals)
    worst = int(np.argmax(strength))  # the least probable, also where probabilities vanish
    if probability[worst] * len(probability) > RARE:
        return Memory(np.zeros_like(found.hessian), "")
    scores = recursion.scores(last) * coordinates.slope(found.z)
    root = np.linalg.inv(np.linalg.cholesky(found.hessian))
    # sums over all stretches of LAGS samples: the same as weighting the autocovariances as Newey and West do
    sums = np.cumsum(np.pad(scores @ root.T, ((LAGS, LAGS), (0, 0))), axis=0)
    stretches = sums[LAGS:] - sums[:-LAGS]
    size, axes = np.linalg.eigh(stretches.T @ stretches / LAGS)
    grown = root.T @ axes * np.sqrt(np.maximum(size - 1.0, 0.0))
    wider = np.sqrt(1.0 + np.diag(grown @ grown.T) / np.diag(found.inverse))
    text = (
        f"the residuals of {data.labels[worst]} are not white (over {LAGS} samples their autocorrelation is "
        f"{times(np.sqrt(strength[worst]))} that of noise), as a ripple of the torque leaves them: the standard "
        f"deviations are up to {times(np.max(wider))} as wide for it and may still be too small"
    )
    return Memory(np.asarray(grown @ grown.T), text)


def portmanteau(data: FitData, residuals: Array) -> tuple[Array, Array]:
    """Ljung and Box's statistic over its expectation by label, and the probability that white noise shows more."""
    count = np.array([max(1, len(row)) for row in data.rows])
    ahead = np.zeros((len(residuals) + LAGS, len(count)))
    ahead[: len(residuals)] = residuals
    covariance = np.array([np.correlate(e, e[: len(residuals)], "valid") for e in np.ascontiguousarray(ahead.T)])
    correlation = covariance[:, 1:] / np.maximum(covariance[:, :1], 1e-300)
    weights = (count * (count + 2.0))[:, None] / np.maximum(count[:, None] - np.arange(1, LAGS + 1), 1)
    statistic = np.einsum("kl,kl,kl->k", correlation, correlation, weights)
    return statistic / LAGS, chdtrc(LAGS, statistic)
