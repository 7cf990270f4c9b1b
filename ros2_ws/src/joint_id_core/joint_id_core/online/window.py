"""Sliding window of the newest samples of a joint."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError

REST = 50.0  # periods of the longest step between two samples that counts as time of the window
ROUNDING = 1e-9  # part of the surplus of the first part by which instants may be off
TEMPERATURE = "temperature"


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


def parts_of(samples: Recording, longest_s: float, period: float = 0.0) -> list[Recording]:
    """Return samples in parts without a pause, none longer than `longest_s`; `period` (s) is the usual one if known."""
    if samples.duration < min(longest_s, REST * period):  # nearly always
        return [samples]
    at = pauses(samples.time)
    if samples.duration > longest_s:
        edges = np.arange(samples.time[0] + longest_s, samples.time[-1], longest_s)
        at = np.union1d(at, np.searchsorted(samples.time, edges))
    if not len(at):
        return [samples]
    return [samples.slice(first, last) for first, last in pairwise([0, *at.tolist(), len(samples)])]


class _Part(NamedTuple):
    """Samples that were added at once.

    Attributes:
        samples: the samples.
        duration: time that they count for in s.
        warmth: see `_warmth`; None if it was not asked for when they were added.
    """

    samples: Recording
    duration: float
    warmth: tuple[float, int] | None


class SlidingWindow:
    """Keeps the newest samples of one joint, `length_s` seconds of them.

    Time between two parts that are added, a rest or a pause, does not count; there is none within a part.

    The parts are kept as they came, so their arrays must not be changed later. They are joined when a recording of the
    window is asked for, which is seldom: samples that arrive pass through the filter as they are.
    """

    def __init__(self, length_s: float) -> None:
        self._length = length_s
        self._parts: deque[_Part] = deque()
        self._rows = 0  # samples of the parts
        self._old: int | None = None  # samples of the first part that are too old, once this was asked
        self._warmth: tuple[float, int] | None = None  # of the parts, once it was asked
        self._period = self._duration = 0.0
        self.end = -np.inf  # instant of the latest sample in s, -inf before the first

    @property
    def start(self) -> float:
        """Instant of the oldest sample that is kept, in s; inf before the first."""
        if not self._parts:
            return np.inf
        return float(self._parts[0].samples.time[0]) + max(0.0, self._duration - self._length)

    @property
    def period(self) -> float:
        """Newest step between two samples in s; 0 before the second."""
        return self._period

    def append(self, samples: Recording) -> None:
        """Add later samples.

        Raises:
            JointIdError: the samples are not later than those in the window.
        """
        count = len(samples)
        if not count:
            return
        begin, end = float(samples.time[0]), float(samples.time[-1])
        step, length = begin - self.end, end - begin
        if step <= 0.0:
            raise JointIdError(
                f"{samples.source}: time goes backwards from {self.end:.6f} s to {begin:.6f} s: "
                "these samples were left out"
            )
        if count > 1:
            self._period = length / (count - 1)
        elif step < (self._period or np.inf):  # samples that come one by one
            self._period = step
        counts_s = length + (step if step < REST * self._period else self._period)
        part = _Part(samples, counts_s, None if self._warmth is None else _warmth(samples))
        self._parts.append(part)
        self._take(part, 1)
        self.end, self._old = end, None
        while self._duration - self._parts[0].duration > self._length:
            self._take(self._parts.popleft(), -1)

    def _take(self, part: _Part, sign: int) -> None:
        """Count a part with sign 1, or no more with sign -1."""
        self._rows += sign * len(part.samples)
        self._duration += sign * part.duration
        if self._warmth is not None:
            (total, known), (warm, count) = self._warmth, part.warmth or _warmth(part.samples)
            self._warmth = total + sign * warm, known + sign * count

    def __len__(self) -> int:
        """Number of samples that are kept."""
        return self._rows - self._begin()

    def _begin(self) -> int:
        """Return the number of samples of the first part that are too old: the window begins within it."""
        if self._old is None:
            self._old, surplus = 0, self._duration - self._length
            if surplus > 0.0:
                time = self._parts[0].samples.time
                begin = int(time.searchsorted(time[0] + surplus - ROUNDING * surplus))
                self._old = min(begin, self._rows - 1)  # before the only part there may be all that is too much
        return self._old

    @property
    def newest(self) -> Recording | None:
        """The samples that were added last; None before the first."""
        return self._parts[-1].samples if self._parts else None

    @property
    def duration(self) -> float:
        """Time in s that the samples cover."""
        return self._duration

    @property
    def derived(self) -> frozenset[str]:
        """Channels of the newest samples that are derived; none before the first."""
        return self._parts[-1].samples.derived if self._parts else frozenset()

    @property
    def temperature(self) -> float:
        """Mean temperature of the joint in the window; NaN if it is not known."""
        if self._warmth is None:
            each = [_warmth(part.samples) for part in self._parts]
            self._warmth = sum(total for total, _ in each), sum(count for _, count in each)
        total, known = self._warmth
        if known and self._begin():
            old, count = _warmth(self._parts[0].samples, self._begin())
            total, known = total - old, known - count
        return total / known if known > 0 else np.nan

    def since(self, instant: float) -> SlidingWindow:
        """Return a window of the same length with the samples from an instant in s on."""
        kept = SlidingWindow(self._length)
        kept._period = self._period  # that a pause is one
        for part in self._parts:
            kept.append(part.samples.slice(int(part.samples.time.searchsorted(instant)), len(part.samples)))
        return kept

    def recording(self, since: float = -np.inf) -> Recording:
        """Return the samples of the window from `since` (s) on as one recording, NaN where a part lacks a channel."""
        parts = self._parts
        if len(parts) > 1 and parts[-2].samples.time[-1] < since <= parts[-1].samples.time[0]:  # nearly always, live
            return parts[-1].samples
        found: list[Recording] = []
        for part in reversed(parts):
            if found and part.samples.time[-1] < since:
                break
            found.append(part.samples)
            if part.samples.time[0] <= since:
                break
        found.reverse()
        begin = self._begin() if len(found) == len(parts) else 0
        begin = max(begin, int(found[0].time.searchsorted(since)))
        if begin == len(found[0]) and len(found) > 1:
            found, begin = found[1:], 0
        found[0] = found[0].slice(begin, len(found[0])) if begin else found[0]
        return _joined(found)


def _warmth(samples: Recording, end: int | None = None) -> tuple[float, int]:
    """Return the sum of the temperatures of samples, of those before the number `end`, and how many are known."""
    warm = samples.channels.get(TEMPERATURE)
    if warm is None:
        return 0.0, 0
    warm = warm[:end]
    total = float(warm.sum())
    if total == total:
        return total, len(warm)
    known = warm[np.isfinite(warm)]
    return float(known.sum()), len(known)


def _joined(parts: Sequence[Recording]) -> Recording:
    """Return later and later samples of a joint as one recording, NaN where a part lacks a channel."""
    last = parts[-1]
    if len(parts) == 1:
        return last
    names = dict.fromkeys(name for part in parts for name in part.channels)
    derived = frozenset[str]().union(*{part.derived for part in parts})
    channels = {}
    for name in names:
        rows = [part.channels.get(name) for part in parts]
        channels[name] = np.concatenate(
            [np.full(len(part), np.nan) if row is None else row for part, row in zip(parts, rows, strict=True)]
        )
    # the parts and their order were already checked
    return last.trusted(np.concatenate([part.time for part in parts]), channels, derived)
