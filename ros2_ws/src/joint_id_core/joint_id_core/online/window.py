"""Sliding window of the newest samples of a joint."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError

NONE = np.zeros(0)
REST = 50.0  # periods of the longest step between two samples that counts as time of the window


def pauses(time: Array) -> NDArray[np.intp]:
    """Return the numbers of the samples before which there was none for so long that the time does not count."""
    steps = np.diff(time)
    if not len(steps) or steps.max() <= REST * steps.min():  # nearly always: the median takes ten times as long
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero(steps > REST * np.median(steps)) + 1


class SlidingWindow:
    """Keeps the newest samples of one joint, `length_s` seconds of them.

    Time between two parts that are added, a rest or a pause, does not count; there is none within a part.
    """

    def __init__(self, length_s: float) -> None:
        self._length = length_s
        self._parts: deque[Recording] = deque()
        self._durations: deque[float] = deque()
        self._warmth: deque[tuple[float, int]] = deque()  # sum and number of the temperatures in each part
        self._period = self._duration = 0.0
        self._count = 0

    @property
    def end(self) -> float:
        """Instant of the latest sample in s, -inf before the first."""
        return float(self._parts[-1].time[-1]) if self._parts else -np.inf

    @property
    def start(self) -> float:
        """Instant of the oldest sample that is kept, in s; inf before the first."""
        return float(self._parts[0].time[0]) + max(0.0, self.duration - self._length) if self._parts else np.inf

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
        if len(samples) > 1:
            self._period = samples.duration / (len(samples) - 1)
        step = float(samples.time[0]) - end
        self._parts.append(samples)
        self._warmth.append(_warmth(samples))
        self._durations.append(samples.duration + (step if step < REST * self._period else self._period))
        self._duration += self._durations[-1]
        self._count += len(samples)
        while self._duration - self._durations[0] > self._length:
            self._count -= len(self._parts.popleft())
            self._duration -= self._durations.popleft()
            self._warmth.popleft()

    def __len__(self) -> int:
        """Number of samples that are kept."""
        if not self._parts:
            return 0
        return self._count - int(np.searchsorted(self._parts[0].time, self.start))

    @property
    def duration(self) -> float:
        """Time in s that the samples cover."""
        return self._duration

    @property
    def temperature(self) -> float:
        """Mean temperature of the joint in the window; NaN if it is not known."""
        if not self._parts:
            return np.nan
        first = self._parts[0]
        sums = [_warmth(first, int(np.searchsorted(first.time, self.start))), *list(self._warmth)[1:]]
        count = sum(n for _, n in sums)
        return sum(total for total, _ in sums) / count if count else np.nan

    def recording(self, since: float = -np.inf) -> Recording:
        """Return the samples of the window from `since` (s) on as one recording, NaN where a part lacks a channel."""
        parts: list[tuple[Recording, slice]] = []
        surplus = self.duration - self._length
        for part in reversed(self._parts):
            start = since
            if part is self._parts[0] and surplus > 0.0:
                start = max(since, float(part.time[0]) + surplus - 1e-9 * abs(surplus))
            if part.time[-1] < start:
                break
            first = int(np.searchsorted(part.time, start)) if part.time[0] < start else 0
            parts.append((part, slice(first, None)))
        parts.reverse()
        if not parts:
            parts.append((self._parts[-1], slice(len(self._parts[-1]), None)))
        names: dict[str, None] = {}
        for part, _ in parts:
            names |= dict.fromkeys(part.channels)
        derived = frozenset().union(*(part.derived for part, _ in parts))
        channels = {
            n: np.concatenate(
                [p.channels[n][rows] if n in p.channels else np.full(len(p), np.nan)[rows] for p, rows in parts]
            )
            for n in names
        }
        # the parts and their order were already checked
        return parts[-1][0].trusted(np.concatenate([p.time[rows] for p, rows in parts]), channels, derived)


def _warmth(samples: Recording, first: int = 0) -> tuple[float, int]:
    """Return sum and number of the known temperatures from a sample on."""
    warm = samples.channels.get("temperature", NONE)[first:]
    known = warm[np.isfinite(warm)]
    return float(known.sum()), len(known)
