"""Innovations of the newest window, and whether they are as large as the noise levels allow."""

from __future__ import annotations

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
        self._blocks: list[Array] = []

    def add(self, white: Array) -> None:
        """Add those of a block, shape (T, labels), NaN where a label is missing."""
        self._blocks.append(white)
        del self._blocks[: -self._count]

    def clear(self) -> None:
        """Forget all."""
        self._blocks.clear()

    @property
    def chi2(self) -> float | None:
        """Their mean square; None before the first block."""
        return float(np.nanmean(np.concatenate(self._blocks) ** 2)) if self._blocks else None

    @property
    def noise_changed(self) -> bool:
        """Whether those of a label are far from what the noise levels allow."""
        for row in np.concatenate(self._blocks).T:
            known = row[np.isfinite(row)]
            if len(known) > ENOUGH and not QUIETER < float(known @ known) / len(known) < NOISIER:
                return True
        return False
