"""Autocorrelated residuals widen the covariance.

A ripple of the friction or the filter of a drive leave such residuals. The test of Ljung & Box (1978) looks at each
label's residuals over many lags at once. If they are not white, the scores of successive samples are correlated, and
the variance of their sum differs from the information matrix. This variance is then estimated from the data (Newey &
West, Econometrica 55, 1987), and the estimates get the sandwich covariance.
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
RARE = 1e-4  # probability under white noise (p-value) below which residuals count as autocorrelated


@dataclass(frozen=True)
class Memory:
    """Effect of autocorrelated residuals.

    Attributes:
        excess: addition to the covariance of the coordinates, shape (k, k); zero for white residuals.
        text: warning for the user; empty for white residuals.
    """

    excess: Array
    text: str


def memory(recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass) -> Memory:
    """Test the residuals of a fit for autocorrelation; `last` is its latest pass."""
    data = recursion.data
    strength, probability = portmanteau(data, last.residuals)
    worst = int(np.argmax(strength))  # the least probable label, also where probabilities underflow to zero
    if probability[worst] * len(probability) > RARE:
        return Memory(np.zeros_like(found.hessian), "")
    scores = recursion.scores(last) * coordinates.slope_at(last.free)
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
    """Return Ljung and Box's statistic over its expectation, and its p-value under white noise, both (labels,)."""
    count = np.array([max(1, len(row)) for row in data.rows])
    ahead = np.zeros((len(residuals) + LAGS, len(count)))
    ahead[: len(residuals)] = residuals
    covariance = np.array([np.correlate(e, e[: len(residuals)], "valid") for e in np.ascontiguousarray(ahead.T)])
    correlation = covariance[:, 1:] / np.maximum(covariance[:, :1], 1e-300)
    weights = (count * (count + 2.0))[:, None] / np.maximum(count[:, None] - np.arange(1, LAGS + 1), 1)
    statistic = np.einsum("kl,kl,kl->k", correlation, correlation, weights)
    return statistic / LAGS, chdtrc(LAGS, statistic)
