"""Covariance of fits whose residuals have a memory (Newey and West, Econometrica 55, 1987), and by a jackknife."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy  # whose parts load when used
from numpy.typing import NDArray

from joint_id_core.data.recording import Array

# 97.5 % quantile of t with a Bartlett kernel that reaches over the share b of the samples: 1.96 + 2.97 b + ...
# (Kiefer and Vogelsang, Econometric Theory 21, 2005).
FIXED_B = np.array([1.96, 2.9694, 0.4160, -0.5324])
BLOCKS = (5, 10)  # least and most of a jackknife
LONGEST_SHARE = 0.25  # of a record: a longer memory cannot be told from a trend


def automatic_lag(scores: Array) -> float:
    """Return the lag in samples from first-order autoregressions of the scores (T, k) (Andrews, Econometrica 59, 1991).

    It is that of the parameter with the longest memory, at least 1.
    """
    before, after = scores[:-1], scores[1:]
    energy = np.sum(before**2, axis=0)
    rho = np.clip(np.sum(before * after, axis=0) / np.where(energy > 0.0, energy, 1.0), -0.97, 0.97)
    memory = 4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
    return float(np.max(1.1447 * (memory * len(scores)) ** (1.0 / 3.0), initial=1.0))


def newey_west(
    columns: Array, residuals: Array, pieces: NDArray[np.int64], lag: float, precision: Array | float = 0.0
) -> Array:
    """Return the covariance (k, k) of least squares with columns (T, k) and residuals (T,).

    Args:
        columns, residuals: of the fit.
        pieces: number of the stretch of each sample, shape (T,): samples of different stretches are independent.
        lag: in samples, over which the weights of a Bartlett kernel fall to zero.
        precision: see `sandwich`.
    """
    count, parameters = columns.shape
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = columns / scale
    scores = scaled * residuals[:, None]
    lag = min(lag, LONGEST_SHARE * count)
    # Bartlett weights 1 - k / lag are those of two whole lags, mixed.
    whole = int(np.ceil(lag)) - 1
    share = (whole + 1) * (1.0 - whole / lag)
    middle = share * _summed(scores, pieces, whole + 1)
    if whole:
        middle = middle + (1.0 - share) * _summed(scores, pieces, whole)
    wider = float(np.polynomial.polynomial.polyval(lag / count, FIXED_B)) / FIXED_B[0]
    freedom = count / max(1, count - parameters)
    return sandwich(scaled, middle * (freedom * wider**2), scale, precision)


def sandwich(scaled: Array, middle: Array, scale: Array, precision: Array | float = 0.0) -> Array:
    """Return the covariance (k, k) of least squares with some columns, those of `scaled` (T, k) times `scale` (k,).

    With information G of the columns and L beforehand, errors are (G + L)^-1 (s - L x): s the scores, and x the error
    of what is known beforehand, which has the covariance L^-1.

    Args:
        scaled, scale: the columns.
        middle: covariance (k, k) of the scores of the scaled columns.
        precision: L, the inverse of the covariance (k, k) that is known beforehand, or 0.
    """
    before = precision / np.outer(scale, scale)
    inverse = np.linalg.pinv(scaled.T @ scaled + before, hermitian=True)
    return np.asarray(inverse @ (middle + before) @ inverse / np.outer(scale, scale))


def _summed(scores: Array, pieces: NDArray[np.int64], lag: int) -> Array:
    """Return the sum of the covariances (k, k) of scores (T, k) over whole lags, with Bartlett weights.

    It is that of their sums over all stretches of `lag` samples: the work does not grow with the lag.
    """
    total = np.zeros((scores.shape[1], scores.shape[1]))
    edges = np.flatnonzero(np.diff(pieces)) + 1
    for piece in np.split(scores, edges):
        sums = np.cumsum(np.pad(piece, ((lag, lag), (0, 0))), axis=0)
        stretches = sums[lag:] - sums[:-lag]
        total += stretches.T @ stretches / lag
    return total


def jackknife(values: Callable[[NDArray[np.bool_]], Array], count: int, lag: float) -> Array:
    """Return the covariance (k, k) of values (k,) of a fit of those of `count` samples that are True.

    It is that of the scatter when one block of the samples at a time is left out (Kuensch, Annals of Statistics 17,
    1989), widened for so few blocks as Student's t. A block is as long as the memory `lag` in samples, as far as that
    leaves enough blocks. Where a motion hardly repeats itself this is safer than Newey and West's: on the axes of a
    KUKA that is half as wide, and too small.
    """
    number = int(np.clip(count / max(lag, 1.0), *BLOCKS))
    found = []
    for block in np.array_split(np.arange(count), number):
        kept = np.ones(count, dtype=bool)
        kept[block] = False
        found.append(values(kept))
    apart = np.array(found) - np.mean(found, axis=0)
    wider = float(scipy.special.stdtrit(number - 1, 0.975)) / FIXED_B[0]
    return np.asarray((number - 1) / number * wider**2 * apart.T @ apart)


def autocorrelation(residuals: Array, lag: int) -> float:
    """Return the autocorrelation of residuals (T,) at a lag in samples; 0 if there are too few."""
    energy = float(residuals @ residuals)
    if lag >= len(residuals) or energy == 0.0:
        return 0.0
    return float(residuals[lag:] @ residuals[:-lag]) / energy
