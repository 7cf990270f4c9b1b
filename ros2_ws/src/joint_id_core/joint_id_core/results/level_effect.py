"""Intervals that contain that the noise levels are estimates as well, from the same samples.

The likelihood takes levels too small, as a sum of squares over the number of samples instead of the degrees of freedom
that are left; residual maximum likelihood has them right (Patterson & Thompson, Biometrika 58, 1971). A level from few
degrees of freedom gives intervals with the tails of Student's distribution. And a level that a record does not show may
be anything up to where the record would show it; before the data every standard deviation counts as equally likely
(Gelman, Bayesian Analysis 1, 2006).

Over minutes all this is little. In two seconds, where noise of an encoder hides that of the drive, standard deviations
were a fifth too small; where the noise of the drive came out as 0, some estimates were nine of them off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from joint_id_core.data.recording import Array

INTERVAL = 0.975  # quantile of Student's distribution that has to be right: that of intervals of 95 %
LONGEST = 1.0  # longest correction of the logarithm of a variance


@dataclass(frozen=True)
class LevelEffect:
    """How the variances of k coordinates depend on L noise levels.

    Attributes:
        slopes: of the logarithms of the variances by those of the levels, shape (k, L).
        score: what the likelihood lacks of the slope by the logarithms of the levels, shape (L,).
        hidden: logarithms of the factors of the standard deviations that contain a level which the record only limits,
            shape (k, L).
        information: of the record on the logarithm of each level, shape (L,).
    """

    slopes: Array
    score: Array
    hidden: Array
    information: Array

    def wider(self, covariance: Array, information: Array, corrected: bool = False) -> Array:
        """Return factors of the standard deviations, shape (k,).

        Args:
            covariance: of the logarithms of the levels, from this record or from more samples, shape (L, L).
            information: of these samples on the logarithm of each level, shape (L,).
            corrected: whether the levels are those of residual maximum likelihood already.
        """
        shift = np.zeros_like(self.score) if corrected else np.clip(covariance @ self.score, -LONGEST, LONGEST)
        # what limits a standard deviation grows with the root of the information
        left = np.sqrt(np.minimum(1.0, self.information / np.maximum(information, 1e-300)))
        return np.asarray(
            np.maximum(1.0, np.exp(0.5 * self.slopes @ shift) * self.tails(covariance, INTERVAL))
            * np.exp(self.hidden @ left)
        )

    def tails(self, covariance: Array, quantile: float) -> Array:
        """Return quantiles of Student's distributions over that of the normal one, shape (k,).

        `covariance` (L, L) is that of the logarithms of the levels.
        """
        variance = np.einsum("kl,lm,km->k", self.slopes, covariance, self.slopes)
        return np.asarray(stdtrit(2.0 / np.maximum(variance, 1e-6), quantile) / ndtri(quantile))
