"""Innovations of the newest window, and whether they are as large as the noise levels allow."""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.online.memory import BLOCK_S

NOISIER = 1.5  # mean squared innovation of a label from which its noise is no longer that of the memory
QUIETER = 0.6  # the same, below which
ENOUGH = 100  # samples for a mean square


class NewestInnovations:
    """Innovations over their standard deviations, of the blocks of the last window.

    Args:
        window_s: length of the window in s.
    """

    def __init__(self, window_s: float) -> None:
        self._count = max(1, round(window_s / BLOCK_S))
        self._sums: list[Array] = []  # of each block: sums of squares, and numbers of values, shape (2, labels)

    def add(self, white: Array) -> None:
        """Add those of a block, shape (T, labels), NaN where a label is missing."""
        known = np.isfinite(white)
        row = np.where(known, white, 0.0)
        self._sums.append(np.array([(row * row).sum(axis=0), known.sum(axis=0)]))
        del self._sums[: -self._count]

    def clear(self) -> None:
        """Forget all."""
        self._sums.clear()

    @property
    def chi2(self) -> float | None:
        """Their mean square; None before the first block, NaN if every label is missing."""
        if not self._sums:
            return None
        squares, count = np.sum(self._sums, axis=(0, 2)).tolist()
        return squares / count if count else math.nan

    @property
    def noise_changed(self) -> bool:
        """Whether those of a label are far from what the noise levels allow."""
        squares, count = np.sum(self._sums, axis=0)
        known = count > ENOUGH
        size = squares[known] / count[known]
        return bool(((size <= QUIETER) | (size >= NOISIER)).any())
