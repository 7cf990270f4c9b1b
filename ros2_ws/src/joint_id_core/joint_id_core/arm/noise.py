"""What a fit leaves of the torque of a joint, as noise: its size, and over which time it remembers itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from joint_id_core.arm.equations import KEPT, RATE
from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.covariance import autocorrelation


@dataclass(frozen=True)
class Noise:
    """Noise of the torque of a joint at the link below 8 Hz.

    Attributes:
        std_dev: in Nm; NaN where the joint did not move.
        memory: in s: noise whose autocorrelation falls as exp(-t / memory) makes estimates as uncertain as this one.
    """

    std_dev: float
    memory: float


def noise_of(left: Array, lag: float) -> Noise:
    """Return the noise of residuals in Nm, shape (T,), `KEPT / RATE` apart, which remember over a lag in samples.

    The memory is that of a first-order autoregression with the same first autocorrelation, or with the same sum of
    autocorrelations, with Bartlett weights, if that is longer.
    """
    if not len(left):
        return Noise(float("nan"), float("nan"))
    shares = range(1, math.ceil(lag))
    total = 1.0 + 2.0 * sum((1.0 - k / lag) * autocorrelation(left, k) for k in shares)
    rho = max(0.0, (total - 1.0) / (total + 1.0), autocorrelation(left, 1))
    memory = -KEPT / RATE / math.log(rho) if rho > 0.0 else 0.0
    return Noise(float(np.sqrt(np.mean(left**2))), memory)
