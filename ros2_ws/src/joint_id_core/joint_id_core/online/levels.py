"""Noise levels that follow the samples.

Under a position controller the noise of the sensors reaches the drive. Parameters are then unbiased only with the
right noise levels: levels 7 % too small moved the inertias of a joint by 5 standard deviations. A window tells its
levels to some percent, so they are learned from all samples, by scoring steps of the likelihood (recursive maximum
likelihood, Ljung, System Identification, 2nd ed., ch. 11).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.noise import bounded_step
from joint_id_core.online.noise_effects import cross_information, noise_information, weight
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker

MOST_LOST = 0.9  # largest part of the information on a combination of parameters that the levels can take
DOUBTED = 0.1  # part of the information that is kept where the newest samples show other levels
ROUNDED = 1e-13  # smallest eigenvalue of a matrix with a unit diagonal that rounding leaves
LEAST = 1e-3  # information that keeps a matrix regular
UNKNOWN = 1.0  # standard deviation of the logarithm of a level before any sample
FARTHEST = 1e4  # factor of a variance between the first window and later ones


class Levels:
    """Noise variances of labels and inputs.

    Args:
        values: of a fit of a whole window, shape (L,).
        parameters: number of free parameters, k.
        sigma: standard deviation of the logarithms of `values` if samples that will not be learned from told them.

    Attributes:
        values: those of today.
    """

    def __init__(self, values: Array, parameters: int, sigma: float = np.inf) -> None:
        self.values = values
        self._lower, self._upper = values / FARTHEST, values * FARTHEST
        self._information = np.diag(np.full(len(values), sigma**-2.0))
        self._cross = np.zeros((parameters, len(values)))
        self._seen = 0  # stretches

    def learn(self, tracker: Tracker, pieces: Sequence[Piece], memory_s: float) -> None:
        """Learn from stretches that are described by the parameters; the filter goes on with the new levels."""
        for piece in pieces:
            found = noise_information(tracker, piece)
            if found is None:
                continue
            score, information = found
            kept = np.exp(-piece.duration / memory_s)
            self._information = kept * self._information + information
            self._cross = kept * self._cross
            if count := weight(self._seen):
                cross = _credible(cross_information(tracker, piece), piece.matrix, information)
                self._cross += count * cross
            self._seen += 1
            step, _ = bounded_step(tracker.kernel, self.values, self._lower, self._upper, score, self._information)
            self.values = self.values * np.exp(step)
            tracker.levels = self.values

    def doubt(self) -> None:
        """Forget most of what is known of the levels: the newest samples show other ones."""
        self._information = DOUBTED * self._information
        self._cross = DOUBTED * self._cross

    def forget(self, changed: Sequence[int]) -> None:
        """Forget how parameters that changed depended on the levels."""
        self._cross[list(changed)] = 0.0

    def wider(self, inverse: Array) -> Array:
        """Return the matrix W (k, k) that widens a covariance C of the parameters for the levels: W C W'.

        Parameters and levels have the information matrix [[H, D], [D', L]]; so the information on the parameters alone
        is H - D L^-1 D'. `inverse` (k, k) is that of H.
        """
        known = self._information + np.diag(np.full(len(self.values), UNKNOWN**-2))
        scale = np.sqrt(np.diag(inverse))
        size, turned = np.linalg.eigh(inverse / np.outer(scale, scale))
        size = np.sqrt(np.maximum(size, ROUNDED))
        root, back = scale[:, None] * turned * size, (turned / size).T / scale
        lost, axes = np.linalg.eigh(root.T @ self._cross @ np.linalg.solve(known, self._cross.T) @ root)
        factor = 1.0 / np.sqrt(1.0 - np.minimum(lost, MOST_LOST))
        return np.asarray(root @ (axes * factor) @ axes.T @ back)


def _credible(cross: Array, matrix: Array, information: Array) -> Array:
    """Return the `cross` information (k, L) of a stretch, scaled down to what the information on each side allows.

    With too much, [[H, D], [D', L]] would not be positive definite, which is possible where a stretch is not linear.
    """
    H = matrix + np.diag(np.full(len(matrix), LEAST))
    most = np.linalg.eigvals(
        np.linalg.solve(information + LEAST * np.eye(len(information)), cross.T @ np.linalg.solve(H, cross))
    )
    return np.asarray(cross / max(1.0, float(np.sqrt(np.max(most.real)))))
