"""Covariance of least squares whose residuals are autoregressions of first order, one of each joint.

Newey and West's covariance sees the memory of residuals as far as a record shows it. A fit takes the slowest part of
the noise for motion, so what it leaves does not show that (the covariance is too small in short records: Andrews,
Econometrica 59, 1991). A model of the noise does.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from joint_id_core.arm.equations import KEPT, RATE
from joint_id_core.arm.noise import Noise, noise_of
from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.covariance import sandwich


def autoregressive(
    columns: Array,
    residuals: Array,
    joint: NDArray[np.intp],
    pieces: NDArray[np.int64],
    lag: float,
    precision: Array | float = 0.0,
) -> Array:
    """Return the covariance (k, k) of least squares with columns (T, k) and residuals (T,).

    Args:
        columns, residuals: of the fit, `KEPT / RATE` apart.
        joint: number of the joint of each equation, (T,).
        pieces: of recording and joint, (T,): those of different pieces are independent.
        lag: in samples, over which residuals remember.
        precision: see `sandwich`.
    """
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    scaled = columns / size
    middle = np.zeros((columns.shape[1], columns.shape[1]))
    for j in np.unique(joint):
        noise = noise_of(residuals[joint == j], lag)
        for k in np.unique(pieces[joint == j]):
            middle += of_products(scaled[pieces == k], noise)
    return sandwich(scaled, middle, size, precision)


def of_products(columns: Array, noise: Noise) -> Array:
    """Return the covariance (k, k) of the sums of columns (T, k) times a noise; instants are `KEPT / RATE` apart."""
    rho = math.exp(-KEPT / RATE / noise.memory) if noise.memory > 0.0 else 0.0
    # the autocovariance rho^|i - j| is a filter forwards, and one backwards
    ahead, behind = (lfilter([1.0], [1.0, -rho], rows, axis=0) for rows in (columns, columns[::-1]))
    middle = noise.std_dev**2 * columns.T @ (ahead + behind[::-1] - columns)
    return np.asarray(0.5 * (middle + middle.T))
