"""Sliding window of the latest samples of a joint."""

from __future__ import annotations

from collections import deque

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError


class SlidingWindow:
    """Keeps the samples of one joint of the last `length_s` seconds."""

    def __init__(self, length_s: float) -> None:
        self._length = length_s
        self._parts: deque[Recording] = deque()

    @property
    def end(self) -> float:
        """Instant of the latest sample in s, -inf before the first."""
        return float(self._parts[-1].time[-1]) if self._parts else -np.inf

    @property
    def start(self) -> float:
        """Instant of the oldest sample that is kept, in s; inf before the first."""
        return float(self._parts[0].time[0]) if self._parts else np.inf

    def append(self, samples: Recording) -> None:
        """Add later samples.

        Raises:
            JointIdError: the samples are not later than those in the window.
        """
        if not len(samples):
            return
        end = self.end
        if samples.time[0] <= end:
            raise JointIdError(
                f"{samples.source}: time goes backwards from {end:.6f} s to {samples.time[0]:.6f} s: "
                "these samples were left out"
            )
        self._parts.append(samples)
        start = self.end - self._length
        while self._parts[0].time[-1] < start:
            self._parts.popleft()

    def mean(self, name: str) -> float:
        """Return the mean of the values of a channel in the window; NaN if there are none."""
        start = self.end - self._length
        parts = [part[name][np.searchsorted(part.time, start) :] for part in self._parts if name in part]
        values = np.concatenate([np.zeros(0), *parts])
        known = values[np.isfinite(values)]
        return float(known.mean()) if len(known) else np.nan

    def recording(self, since: float = -np.inf) -> Recording:
        """Return the samples of the window from `since` (s) on as one recording, NaN where a part lacks a channel."""
        start = max(since, self.end - self._length)
        parts: list[tuple[Recording, slice]] = []
        for part in reversed(self._parts):
            first = int(np.searchsorted(part.time, start))
            parts.append((part, slice(first, None)))
            if first:
                break
        parts.reverse()
        names: dict[str, None] = {}
        for part, _ in parts:
            names |= dict.fromkeys(part.channels)
        derived = frozenset().union(*(part.derived for part, _ in parts))
        channels = {
            n: np.concatenate([p.channels[n][rows] if n in p else np.full(len(p), np.nan)[rows] for p, rows in parts])
            for n in names
        }
        # the parts and their order were already checked
        return parts[-1][0].trusted(np.concatenate([p.time[rows] for p, rows in parts]), channels, derived)
