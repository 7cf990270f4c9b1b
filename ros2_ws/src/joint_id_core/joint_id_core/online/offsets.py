"""Offsets of sensors belong to the recording and not to the joint: they may drift unseen.

A memory of a minute knows an offset so well that a new one is many standard deviations away, long before the newest
samples can show it. So its interval is at least as wide as what the samples of two windows tell: by then a change that
is beyond the interval has been found.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.models import Model
from joint_id_core.online.piece import Piece

WINDOWS = 2.0  # in which a change must be found
REACH = 1.25  # a change of five standard deviations of these samples is found, and an interval holds four of its own


class Offsets:
    """Widens the intervals of the parameters that belong to the recording."""

    def __init__(self, model: Model, free: Sequence[str], spread: Array, window_s: float) -> None:
        self._at = np.array([k for k, name in enumerate(free) if model.parameter(name).of_recording], dtype=np.intp)
        self._before, self._seconds = 1.0 / spread[self._at] ** 2, WINDOWS * window_s

    def widened(self, covariance: Array, blocks: Sequence[Piece]) -> Array:
        """Return the covariance (k, k) of the coordinates; `blocks` of samples are in it, the newest one last.

        Blocks that are shorter together stand for as much as two windows would show.
        """
        if not len(self._at) or not len(blocks):
            return covariance
        shown, seconds = np.zeros(len(self._at)), 0.0
        for block in reversed(blocks):
            shown += block.matrix[self._at, self._at]
            seconds += block.duration
            if seconds >= self._seconds:
                break
        shown = self._before + shown * max(1.0, self._seconds / max(seconds, 1e-9))
        wider = covariance.copy()
        wider[self._at, self._at] = np.maximum(wider[self._at, self._at], REACH**2 / shown)
        return wider
