"""Whether both halves of a recording ask for the same values, and intervals that contain it if they do not.

Friction that warms or a load that is picked up leaves residuals with a long memory, but the covariance for these is far
too small: it reckons with values that scatter about one truth. Source: Chow, Econometrica 28 (1960), with the
covariances of both halves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from joint_id_core.estimators.regression.least_squares import Solution

CHANCE = 1e-3  # of a joint that stays the same that a parameter seems to differ
LEAST = 10  # samples for each parameter in a half


def with_halves(found: Solution, count: int, ask: Callable[[slice], Solution]) -> Solution:
    """Return a solution of `count` samples whose covariance contains how far the halves are from it.

    Args:
        found: of all samples.
        count: number of samples.
        ask: returns the solution of some of them.
    """
    middle = count // 2
    if middle < LEAST * len(found.values):
        return found
    first, second = ask(slice(0, middle)), ask(slice(middle, count))
    seen = ~(found.unseen | found.held | first.unseen | first.held | second.unseen | second.held)
    apart = np.where(seen, first.values - second.values, 0.0)
    variance = np.where(seen, first.sigma**2 + second.sigma**2, 1.0)
    differs = apart**2 > chdtri(1.0, CHANCE) * variance
    if not differs.any():
        return found
    changes = np.where(differs, 0.5 * np.abs(apart), 0.0)
    halves = np.where(differs, [first.values, second.values], np.nan)
    return replace(found, covariance=found.covariance + np.diag(changes**2), changes=changes, halves=halves)
