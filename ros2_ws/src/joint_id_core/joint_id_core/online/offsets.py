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
from joint_id_core.online.memory import Memory
from joint_id_core.online.piece import Piece

WINDOWS = 2.0  # in which a change must be found
REACH = 1.25  # a change of five standard deviations of these samples is found, and an interval holds four of its own


class Offsets:
    """Widens the intervals of the parameters that belong to the recording."""

    def __init__(self, model: Model, free: Sequence[str], spread: Array, window_s: float) -> None:
        self._at = np.array([k for k, name in enumerate(free) if model.parameter(name).of_recording], dtype=np.intp)
        self._before, self._seconds = 1.0 / spread[self._at] ** 2, WINDOWS * window_s
        self._least: tuple[Piece, dict[int, float]] | None = None  # newest block, variances by place with it

    def widened(self, covariance: Array, memory: Memory) -> Array:
        """Return the covariance (k, k) of the coordinates, in which the blocks of a memory are.

        Blocks that are shorter together than two windows stand for as much as these would show.
        """
        newest = memory.newest
        if not len(self._at) or newest is None:
            return covariance
        if self._least is None or self._least[0] is not newest:  # it stays for half a second
            least = self._least_of(memory.blocks)
            self._least = newest, dict(zip(self._at.tolist(), least.tolist(), strict=True))
        wider = covariance.copy()
        for k, variance in self._least[1].items():  # one or two
            wider[k, k] = max(wider[k, k], variance)
        return wider

    def _least_of(self, blocks: Sequence[Piece]) -> Array:
        """Return the least variances."""
        shown, seconds = np.zeros(len(self._at)), 0.0
        for block in reversed(blocks):
            shown += block.matrix[self._at, self._at]
            seconds += block.duration
            if seconds >= self._seconds:
                break
        shown = self._before + shown * max(1.0, self._seconds / max(seconds, 1e-9))
        return np.asarray(REACH**2 / shown)
