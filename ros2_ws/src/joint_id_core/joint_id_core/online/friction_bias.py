"""Bias from the smoothing of Coulomb friction, as samples arrive.

The online filter has sharper friction than a fit (`sharpness`), but a joint that sticks still creeps a little, and
over minutes the intervals become smaller than what this does to the estimates. As in a fit of a whole window
(`estimators.innovations.sharpness`), blocks of samples pass once more with friction that is sharper still. Its
likelihood is no help here: over minutes what the linearised filter lacks near standstill is larger than the difference.
So the bias counts in full, as far as it is more than scatter: noise moves the two estimates apart, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.sharpness import SHARPER
from joint_id_core.online.noise_effects import RARELY, sharper
from joint_id_core.online.piece import Piece
from joint_id_core.online.summed_effect import SummedEffect
from joint_id_core.online.tracker import Tracker

FIRST = 64  # blocks of which each one passes again, because some of them hold no reversal; later one in `RARELY`


class FrictionBias:
    """Effect of smooth friction on what a memory knows of the parameters, a `SummedEffect`."""

    def __init__(self, effect: SummedEffect) -> None:
        self._effect = effect

    def learn(self, tracker: Tracker, pieces: Sequence[Piece], memory_s: float) -> None:
        """Measure the effect on the score of blocks that were added to the memory."""
        if not tracker.sharpened:
            return
        for piece in pieces:
            seen = self._effect.seen
            count = 1 if seen < FIRST else RARELY * (seen % RARELY == 0)
            effect = count * sharper(tracker, piece, SHARPER) if count else None
            self._effect.add(effect, piece.duration, memory_s)

    def excess(self, inverse: Array) -> Array:
        """Return what is added to the covariance, shape (k, k); `inverse` (k, k) is that of the information matrix."""
        return self._effect.once(inverse, self._excess)

    def _excess(self, inverse: Array) -> Array:
        moved, scatter = self._effect.moves(inverse)
        sure = np.sqrt(np.maximum(0.0, 1.0 - scatter / np.maximum(moved**2, 1e-300)))
        bias = self._effect.bounded(sure * moved * SHARPER / (SHARPER - 1.0))
        return np.outer(bias, bias)

    def changed(self, changed: Sequence[int], inverse: Array, precision: Array) -> FrictionBias:
        """Return the effect on what is still known when parameters changed: see `SummedEffect.changed`."""
        return FrictionBias(self._effect.changed(changed, inverse, precision))
