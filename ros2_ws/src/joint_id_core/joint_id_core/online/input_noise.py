"""Bias from noise of sensors whose signals are inputs of the model (errors in variables), as samples arrive.

The filter takes noise of an input for something that moves the joint. Noise of an encoder, or of the sensor of the
current, is in the record and moves nothing, which biases the estimates: more and more standard deviations of them, as
these shrink. As in a fit of a whole window (`estimators.innovations.input_noise`), the same noise is added once more,
and the change of the score is measured (simulation extrapolation, Cook & Stefanski 1994; Nakamura's corrected score,
Biometrika 77, 1990).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.online.noise_effects import attenuation, weight
from joint_id_core.online.piece import Piece
from joint_id_core.online.summed_effect import SummedEffect
from joint_id_core.online.tracker import Tracker


class InputNoise:
    """Effect of the noise of inputs on what a memory knows of the parameters, a `SummedEffect`."""

    def __init__(self, effect: SummedEffect) -> None:
        self._effect = effect
        self._rng = np.random.default_rng(0)

    def learn(self, tracker: Tracker, pieces: Sequence[Piece], memory_s: float) -> None:
        """Measure the effect on the score of stretches that were added to the memory."""
        if not tracker.shown_noise:
            return
        for piece in pieces:
            count = weight(self._effect.seen)
            effect = count * attenuation(tracker, piece, self._rng) if count else None
            self._effect.add(effect, piece.duration, memory_s)

    def bias(self, inverse: Array) -> Array:
        """Return the bias of the parameters, shape (k,), which counts as uncertain once it is taken off.

        `inverse` (k, k) is that of the information matrix. Why it is uncertain: see `sensor_bias` of a fit.
        """
        return self._effect.once(inverse, lambda inverse: self._effect.moves(inverse)[0])

    def changed(self, changed: Sequence[int], inverse: Array, precision: Array) -> InputNoise:
        """Return the effect on what is still known when parameters changed: see `SummedEffect.changed`."""
        return InputNoise(self._effect.changed(changed, inverse, precision))
