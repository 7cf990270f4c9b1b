"""Noise levels that follow the samples.

Under a position controller the noise of the sensors reaches the drive. Parameters are then unbiased only with the
right noise levels: levels 7 % too small moved the inertias of a joint by 5 standard deviations. A window tells its
levels to some percent, so they are learned from all samples, by scoring steps of the likelihood (recursive maximum
likelihood, Ljung, System Identification, 2nd ed., ch. 11).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.noise import SHOWN, bounded_step, covariance_of_levels, with_prior
from joint_id_core.online.noise_effects import noise_information
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker
from joint_id_core.results.level_effect import LevelEffect

MOST_LOST = 0.9  # largest part of the information on a combination of parameters that the levels can take
DOUBTED = 0.1  # part of the information that is kept where the newest samples show other levels
LEAST_LOST = 1e-9  # the same below which it makes no difference
MOVED = 0.2  # logarithm of a variance up to which what a block says is kept
FARTHEST = 1e4  # factor of a variance between the first window and later ones


class Levels:
    """Noise variances of labels and inputs.

    Args:
        values: of a fit of a whole window, shape (L,).
        parameters: number of free parameters, k.
        sigma: standard deviation of the logarithms of `values` if samples that will not be learned from told them.
        effect: how the intervals depend on the levels, as the fit found it; None if it is not known.

    Attributes:
        values: those of today.
    """

    def __init__(
        self, values: Array, parameters: int, sigma: float = np.inf, effect: LevelEffect | None = None
    ) -> None:
        self.values, self._effect = values, effect
        self._lower, self._upper = values / FARTHEST, values * FARTHEST
        self._information = np.diag(np.full(len(values), sigma**-2.0))
        self._cross = np.zeros((parameters, len(values)))
        self._mean: Array | None = None  # parameters of the newest step
        self._begin()
        if effect is not None:
            self._lacking = effect.score

    def _begin(self, since: float = -np.inf) -> None:
        """Take what is known for what stretches are added to that begin at `since` (s) or later."""
        self._lacking = np.zeros(len(self.values))  # of the score of the likelihood
        self._before, self._since = (self.values, self._information, self._cross, self._mean), since

    def learn(
        self, tracker: Tracker, pieces: Sequence[Piece], mean: Array, memory_s: float, anew: bool = False
    ) -> Array:
        """Learn from stretches that were added to the memory; the filter goes on with the new levels.

        Levels and parameters take their steps in turn, each at the newest values of the other (Gauss-Seidel).

        Args:
            tracker: that ran over them.
            pieces: the stretches, at parameters near the mean.
            mean: estimate with these stretches, shape (k,).
            memory_s: time constant of forgetting.
            anew: whether these are all stretches since the first one, or since a change, which were learned from before
                at other parameters.

        Returns:
            How the new levels change the vector of the memory, shape (k,).
        """
        score = np.zeros_like(self.values)
        if anew:
            values, self._information, self._cross, self._mean = self._before
            score += self._lacking - self._information @ np.log(self.values / values)
            pieces = [piece for piece in pieces if piece.begin.time >= self._since]
        if self._mean is not None:
            score -= self._cross.T @ (mean - self._mean)
        for piece in pieces:
            found = noise_information(tracker, piece)
            if found is None:
                continue
            kept = np.exp(-piece.duration / memory_s)
            score = kept * score + found.score - found.cross.T @ (mean - piece.z)
            self._information = kept * self._information + found.matrix
            self._cross = kept * self._cross + found.cross
        # Levels that act alike, as of two torques at one link, are known together: without damping one takes the place
        # of the other, and what earlier blocks said of them holds no more.
        damped = with_prior(self._information)
        step, _ = bounded_step(tracker.kernel, self.values, self._lower, self._upper, score, damped)
        self.values = self.values * np.exp(step)
        self._mean = mean
        tracker.levels = self.values
        return np.asarray(-self._cross @ np.expm1(step))  # what noise does is linear in its variance

    def moved(self, blocks: Sequence[Piece]) -> bool:
        """Return whether a level that samples show is far from that at which one of these blocks was passed."""
        if not blocks:
            return False
        away = np.abs(np.log(np.array([block.levels for block in blocks]) / self.values))
        return bool(np.any(away[:, np.diag(self._information) > SHOWN] > MOVED))

    def tails(self, quantile: float) -> Array | None:
        """Return quantiles of standard deviations with these levels over those of normal numbers; None: not known."""
        covariance = covariance_of_levels(self._information)
        return None if self._effect is None else self._effect.tails(covariance, quantile)

    def doubt(self, since: float) -> None:
        """Forget most of what is known of the levels: samples from `since` (s) on show other ones."""
        self._information = DOUBTED * self._information
        self._cross = DOUBTED * self._cross
        self._begin(since)

    def changed(self, changed: Sequence[int], inverse: Array, precision: Array) -> Levels:
        """Return the levels when parameters changed: the others depend on them as before.

        `inverse` (k, k) is that of the information matrix before, `precision` (k, k) that of what is still known.
        """
        slope = -inverse @ self._cross
        slope[list(changed)] = 0.0
        other = copy(self)
        other._cross = -precision @ slope
        other._begin()
        return other

    def wider(self, inverse: Array) -> Array:
        """Return the matrix W (k, k) that widens a covariance C of the parameters for the levels: W C W'.

        Their effect on the size of the innovations comes on top of what follows.

        Parameters and levels have the information matrix [[H, D], [D', L]]; so the information on the parameters alone
        is H - D L^-1 D'. With any root of C = R R', W is R (1 - R' D L^-1 D' R)^(-1/2) R^-1. What is taken from one has
        the rank of L, which is small. `inverse` (k, k) is that of H.
        """
        known = with_prior(self._information)
        seen = np.linalg.solve(np.linalg.cholesky(known), self._cross.T)
        lost, axes = np.linalg.eigh(seen @ inverse @ seen.T)
        lost = np.maximum(lost, LEAST_LOST)
        more = (1.0 / np.sqrt(1.0 - np.minimum(lost, MOST_LOST)) - 1.0) / lost
        along = seen.T @ axes
        found = np.asarray(np.eye(len(inverse)) + (inverse @ along * more) @ along.T)
        if self._effect is None:
            return found
        levels = covariance_of_levels(self._information)
        return self._effect.wider(levels, np.diag(self._information), corrected=True)[:, None] * found
