"""Sliding window of the newest samples of a joint."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError

REST = 50.0  # periods of the longest step between two samples that counts as time of the window
ROUNDING = 1e-9  # part of the surplus of the first part by which instants may be off
ROOM = 256  # rows of the smallest buffer


def extremes(time: Array) -> tuple[float, float]:
    """Return the shortest and the longest step between two or more instants (T,) in s."""
    found = np.empty(2)
    compile_shared().steps(np.ascontiguousarray(time), found)  # a recording may be a part of a table
    return float(found[0]), float(found[1])


def pauses(time: Array) -> NDArray[np.intp]:
    """Return the numbers of the samples before which there was none for so long that the time does not count."""
    if len(time) < 2:
        return np.zeros(0, dtype=np.intp)
    shortest, longest = extremes(time)
    if longest <= REST * shortest:  # nearly always: the median takes ten times as long
        return np.zeros(0, dtype=np.intp)
    steps = time[1:] - time[:-1]
    return np.flatnonzero(steps > REST * np.median(steps)) + 1


def parts_of(samples: Recording, longest_s: float) -> list[Recording]:
    """Return samples in parts without a pause, none longer than `longest_s`."""
    at = pauses(samples.time)
    if samples.duration > longest_s:
        edges = np.arange(samples.time[0] + longest_s, samples.time[-1], longest_s)
        at = np.union1d(at, np.searchsorted(samples.time, edges))
    if not len(at):
        return [samples]
    return [samples.slice(first, last) for first, last in pairwise([0, *at.tolist(), len(samples)])]


@dataclass
class _Part:
    """Samples that were added at once: how many, and the time that they count for, in s."""

    rows: int
    duration: float


@dataclass
class _Kind:
    """Channels of the rows up to number `end`, and which of them are derived."""

    channels: tuple[str, ...]
    derived: frozenset[str]
    end: int


class SlidingWindow:
    """Keeps the newest samples of one joint, `length_s` seconds of them.

    Time between two parts that are added, a rest or a pause, does not count; there is none within a part.

    The samples lie in one array per channel. Recordings of the window are views of these: rows that were written are
    never written again. When the arrays are full, the rows that are kept are copied to new ones.
    """

    def __init__(self, length_s: float) -> None:
        self._length = length_s
        self._parts: deque[_Part] = deque()
        self._kinds: deque[_Kind] = deque()
        self._newest: Recording | None = None
        self._time = np.empty(0)
        self._channels: dict[str, Array] = {}
        self._first = self._last = 0  # rows of the buffer that are kept
        self._period = self._duration = 0.0

    @property
    def end(self) -> float:
        """Instant of the latest sample in s, -inf before the first."""
        return float(self._time[self._last - 1]) if self._parts else -np.inf

    @property
    def start(self) -> float:
        """Instant of the oldest sample that is kept, in s; inf before the first."""
        return float(self._time[self._first]) + max(0.0, self._duration - self._length) if self._parts else np.inf

    def append(self, samples: Recording) -> None:
        """Add later samples.

        Raises:
            JointIdError: the samples are not later than those in the window.
        """
        count, end = len(samples), self.end
        if not count:
            return
        if samples.time[0] <= end:
            raise JointIdError(
                f"{samples.source}: time goes backwards from {end:.6f} s to {samples.time[0]:.6f} s: "
                "these samples were left out"
            )
        step = float(samples.time[0]) - end
        if count > 1:
            self._period = samples.duration / (count - 1)
        elif step < (self._period or np.inf):  # samples that come one by one
            self._period = step
        part = _Part(count, samples.duration + (step if step < REST * self._period else self._period))
        self._write(samples)
        self._parts.append(part)
        self._duration += part.duration
        while self._duration - self._parts[0].duration > self._length:
            old = self._parts.popleft()
            self._first += old.rows
            self._duration -= old.duration
        while self._kinds[0].end <= self._first:
            self._kinds.popleft()

    def _write(self, samples: Recording) -> None:
        """Copy samples behind those in the buffer."""
        count, newest = len(samples), self._newest
        if self._last + count > len(self._time):
            self._move(count)
        begin, self._last = self._last, self._last + count
        self._time[begin : self._last] = samples.time
        if newest is None or samples.channels.keys() != newest.channels.keys() or samples.derived != newest.derived:
            self._kinds.append(_Kind(tuple(samples.channels), samples.derived, self._last))
            for name in samples.channels:
                if name not in self._channels:
                    self._channels[name] = np.full(len(self._time), np.nan)
        self._kinds[-1].end, self._newest = self._last, samples
        for name, values in samples.channels.items():
            self._channels[name][begin : self._last] = values

    def _move(self, more: int) -> None:
        """Move the rows that are kept to new arrays with room for `more` rows, and for as many again."""
        kept = slice(self._first, self._last)
        count = self._last - self._first
        size = max(ROOM, 2 * (count + more))
        names = {name for kind in self._kinds for name in kind.channels}
        old = {"": self._time, **{name: self._channels[name] for name in self._channels if name in names}}
        new = {name: np.full(size, np.nan) for name in old}
        for name, values in old.items():
            new[name][:count] = values[kept]
        self._time = new.pop("")
        self._channels = new
        for kind in self._kinds:
            kind.end -= self._first
        self._first, self._last = 0, count

    def __len__(self) -> int:
        """Number of samples that are kept."""
        return self._last - self._begin() if self._parts else 0

    def _begin(self) -> int:
        """Return the row of the first sample in the window, which begins within the first part."""
        surplus = self._duration - self._length
        if surplus <= 0.0:
            return self._first
        part = self._time[self._first : self._first + self._parts[0].rows]
        begin = self._first + int(part.searchsorted(part[0] + surplus - ROUNDING * surplus))
        return min(
            begin, self._last - 1
        )  # the time before the first sample of the only part may be all that is too much

    @property
    def duration(self) -> float:
        """Time in s that the samples cover."""
        return self._duration

    @property
    def temperature(self) -> float:
        """Mean temperature of the joint in the window; NaN if it is not known."""
        warm = self._channels.get("temperature")
        if warm is None:
            return np.nan
        warm = warm[self._begin() : self._last]
        known = warm[np.isfinite(warm)]
        return float(known.sum()) / len(known) if len(known) else np.nan

    def recording(self, since: float = -np.inf) -> Recording:
        """Return the samples of the window from `since` (s) on as one recording, NaN where a part lacks a channel."""
        assert self._newest is not None
        first = self._begin()
        if first < self._last and since > self._time[first]:
            first += int(self._time[first : self._last].searchsorted(since))
        kinds = [kind for kind in self._kinds if kind.end > first] or [self._kinds[-1]]
        names, derived = kinds[0].channels, kinds[0].derived
        for kind in kinds[1:]:
            names, derived = tuple(dict.fromkeys((*names, *kind.channels))), derived | kind.derived
        rows = slice(first, self._last)
        # the parts and their order were already checked
        return self._newest.trusted(self._time[rows], {name: self._channels[name][rows] for name in names}, derived)
