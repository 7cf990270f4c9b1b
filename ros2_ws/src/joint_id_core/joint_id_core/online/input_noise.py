"""Bias from noise of sensors whose signals are inputs of the model (errors in variables), as samples arrive.

The filter takes noise of an input for something that moves the joint. Noise of an encoder, or of the sensor of the
current, is in the record and moves nothing, which biases the estimates: more and more standard deviations of them, as
these shrink. As in a fit of a whole window (`estimators.innovations.input_noise`), the same noise is added once more,
and the change of the score is measured (simulation extrapolation, Cook & Stefanski 1994; Nakamura's corrected score,
Biometrika 77, 1990).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.online.noise_effects import attenuation, weight
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker


class InputNoise:
    """Effect of the noise of inputs on what a memory knows of k parameters.

    Args:
        spread: standard deviations of the prior, shape (k,): a larger bias is none, there the model does not describe
            the data.
    """

    def __init__(self, spread: Array) -> None:
        self._spread, self._score = spread, np.zeros_like(spread)  # summed, and forgotten as the memory forgets
        self._rng = np.random.default_rng(0)
        self._seen = 0  # stretches
        self._found: tuple[Array, Array, Array] | None = None  # bias, of which inverse and score

    def learn(self, tracker: Tracker, pieces: Sequence[Piece], memory_s: float) -> None:
        """Measure the effect on the score of stretches that were added to the memory."""
        if not tracker.shown_noise:
            return
        for piece in pieces:
            self._score = self._score * np.exp(-piece.duration / memory_s)
            if count := weight(self._seen):
                self._score = self._score + count * attenuation(tracker, piece, self._rng)
            self._seen += 1

    def bias(self, inverse: Array) -> Array:
        """Return the bias of the parameters, shape (k,), which counts as uncertain once it is taken off.

        `inverse` (k, k) is that of the information matrix. Why it is uncertain: see `sensor_bias` of a fit.
        """
        found = self._found
        if found is None or found[1] is not inverse or found[2] is not self._score:
            bias = np.minimum(np.maximum(inverse @ self._score, -self._spread), self._spread)
            found = self._found = bias, inverse, self._score
        return found[0]

    def changed(self, changed: Sequence[int], inverse: Array, precision: Array) -> InputNoise:
        """Return the effect on what is still known when parameters changed.

        `inverse` (k, k) is that of the information matrix before, `precision` (k, k) that of what is still known.
        """
        bias = self.bias(inverse).copy()
        bias[list(changed)] = 0.0
        other = copy(self)
        other._score, other._seen = precision @ bias, 0
        return other
