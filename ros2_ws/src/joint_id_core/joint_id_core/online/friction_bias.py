"""Bias from the smoothing of Coulomb friction, as samples arrive.

The online filter has sharper friction than a fit (`sharpness`), but a joint that sticks still creeps a little, and
over minutes the intervals become smaller than what this does to the estimates. As in a fit of a whole window
(`estimators.innovations.sharpness`), blocks of samples pass once more with friction that is sharper still. Its
likelihood is no help here: over minutes what the linearised filter lacks near standstill is larger than the difference.
So the bias counts in full, as far as it is more than scatter: noise moves the two estimates apart, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.sharpness import SHARPER
from joint_id_core.online.noise_effects import RARELY, sharper
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker

FIRST = 64  # blocks of which each one passes again, because some of them hold no reversal; later one in `RARELY`


class FrictionBias:
    """Effect of smooth friction on what a memory knows of k parameters.

    Args:
        spread: standard deviations of the prior, shape (k,): a larger bias is none, there the model does not describe
            the data.
    """

    def __init__(self, spread: Array) -> None:
        self._spread, self._score = spread, np.zeros_like(spread)  # summed, and forgotten as the memory forgets
        self._scatter = np.zeros((len(spread), len(spread)))  # the sum of the squares
        self._seen = 0  # blocks
        self._found: tuple[Array, Array, Array] | None = None  # what is added, of which inverse and score

    def learn(self, tracker: Tracker, pieces: Sequence[Piece], memory_s: float) -> None:
        """Measure the effect on the score of blocks that were added to the memory."""
        if not tracker.sharpened:
            return
        for piece in pieces:
            kept = float(np.exp(-piece.duration / memory_s))
            self._score, self._scatter = kept * self._score, kept * kept * self._scatter
            if count := 1 if self._seen < FIRST else RARELY * (self._seen % RARELY == 0):
                effect = count * sharper(tracker, piece, SHARPER)
                self._score, self._scatter = self._score + effect, self._scatter + np.outer(effect, effect)
            self._seen += 1

    def excess(self, inverse: Array) -> Array:
        """Return what is added to the covariance, shape (k, k); `inverse` (k, k) is that of the information matrix."""
        found = self._found
        if found is None or found[1] is not inverse or found[2] is not self._score:
            moved = inverse @ self._score
            scatter = np.einsum("ij,jk,ik->i", inverse, self._scatter, inverse)
            sure = np.sqrt(np.maximum(0.0, 1.0 - scatter / np.maximum(moved**2, 1e-300)))
            bias = np.clip(sure * moved * SHARPER / (SHARPER - 1.0), -self._spread, self._spread)
            found = self._found = np.outer(bias, bias), inverse, self._score
        return found[0]

    def changed(self, changed: Sequence[int], inverse: Array, precision: Array) -> FrictionBias:
        """Return the effect on what is still known when parameters changed.

        `inverse` (k, k) is that of the information matrix before, `precision` (k, k) that of what is still known.
        """
        bias, root = inverse @ self._score, inverse.copy()
        bias[list(changed)], root[list(changed)] = 0.0, 0.0
        back = precision @ root
        other = copy(self)
        other._score, other._scatter, other._seen = precision @ bias, back @ self._scatter @ back.T, 0
        return other
