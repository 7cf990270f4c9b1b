"""Changes of parameters that are not sure enough to be told, but too likely to be left out of the intervals.

The test of a change is strict, because a false one costs all that is known of a parameter. So a change whose stretch of
samples tells less than the memory can go on for a long time before it is found, and the estimate moves towards the new
value only slowly. Until then the estimate is a mixture: with the probability of each possible change, it is off by what
this change would make of it. The covariance of the mixture contains these squares (Bayesian model averaging: Hoeting et
al., Statistical Science 14, 1999).
"""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.online.score_test import RANK
from joint_id_core.online.symmetric import solve

# Odds that one parameter changed at the begin of one stretch, before its samples are seen: with ten parameters and a
# stretch that begins every second, once in a quarter of an hour of motion.
SELDOM = 1e-4
UNLIKELY = 0.01  # odds with the samples, below which a change is left out
LEAST = 2.0 * np.log(UNLIKELY / SELDOM)  # the same in squared standard deviations
LARGEST = 50.0  # squared standard deviations from which it makes no difference how many there are


class Doubt:
    """What k parameters may be off by because one of them changed at one of the last blocks."""

    def __init__(self, parameters: int) -> None:
        self._odds, self._sum = 1.0, np.zeros((parameters, parameters))

    def consider(self, precision: Array, matrix: Array, score: Array, information: Array, excess: Array) -> None:
        """Take the changes of each parameter at the begin of one stretch of samples.

        Args:
            precision, matrix: of the memory before the stretch and of the stretch, shapes (k, k).
            score, information: of the change, as `score_of` returns them.
            excess: scatter of earlier stretches, by which the square of each score is divided, shape (k,).
        """
        single = information.diagonal()
        seen = single > RANK * precision.diagonal()  # else what is left of the score is rounding
        single = np.where(seen, single, np.inf)
        square = score**2 / single / excess
        if square.max() < LEAST:  # nearly always
            return
        odds = SELDOM * np.exp(0.5 * np.minimum(square, LARGEST))
        likely = np.flatnonzero(odds > UNLIKELY)
        if len(likely):
            off = solve(precision + matrix, precision[:, likely]) * (score / single)[likely]
            self._odds += float(odds[likely].sum())
            self._sum = self._sum + (off * odds[likely]) @ off.T

    @property
    def covariance(self) -> Array:
        """Mean square of what the estimate is off by, shape (k, k)."""
        return self._sum / self._odds
