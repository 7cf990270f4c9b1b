"""The newest samples of a joint, in motion or at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.shared.computed_load import where_known
from joint_id_core.estimators.shared.stillness import (
    STILL_S,
    still,
    still_link,
    sure_distance,
    sure_speed,
    surely_moves,
    wound_up,
)
from joint_id_core.models import Model
from joint_id_core.online.window import SlidingWindow, extremes, pauses

MOVED_S = 0.5  # a joint counts as moving until it has been seen at rest for so long; a pause of the samples is no rest
EVEN = 1.5  # largest over smallest step of samples that come without gaps
BATCH_S = 0.1  # of samples that are handed on together: the work on a batch hardly depends on its length


class MotionWatch:
    """Takes samples and hands them on as stretches of motion and of rest.

    Samples whose speed already tells that they belong to no rest are handed on at once. Where none is measured, they
    wait until the joint has moved farther than in a rest. Near a reversal, and at a rest, they wait for `STILL_S`.

    Attributes:
        recent: the newest samples, whether the joint moves or not.
        noise: standard deviations of the labels that show rest; None takes them from the samples.
    """

    def __init__(self, model: Model, window_s: float) -> None:
        self.recent = SlidingWindow(max(window_s, 8.0 * STILL_S))
        self.noise: dict[str, float] | None = None
        self._rested_s = np.inf  # time at rest since the newest sample in motion
        self._positions, self._loaded = model.state_names, model.load is not None
        self._done = -np.inf  # newest sample that was handed on
        self._wound: int | None = None  # samples since the joint rested, if the link has not moved since
        self._stood: dict[str, float] | None = None  # positions of the newest sample that was handed on, at rest
        self._fast = False  # whether the newest sample that was handed on is faster than any of a rest

    @property
    def moving(self) -> bool:
        """Whether the joint has moved, and was not seen at rest for half a second since."""
        return self._rested_s < MOVED_S

    def stretches(self, now: bool) -> Iterator[tuple[Recording, bool]]:
        """Yield new stretches and whether the joint moves there; nothing while few samples wait, unless `now`.

        Samples in motion whose load is not known are left out.
        """
        for part, moves in self._stretches(now):
            used = where_known(part) if moves and self._loaded else part
            if len(used):
                yield used, moves

    def _stretches(self, now: bool) -> Iterator[tuple[Recording, bool]]:
        """Yield all stretches, whether their load is known or not."""
        now = now and (self.moving or self._stirs())
        if not now and self.recent.end < self._done + BATCH_S + (0.0 if self.moving else STILL_S):
            return
        sure = self._sure()
        if sure is not None:
            self._done, self._rested_s = float(sure.time[-1]), 0.0  # its last sample is fast, too
            yield sure, True
        if self._done >= self.recent.end:  # nearly always in motion
            return
        recent, until = self.recent.recording(self._done - 2.0 * STILL_S), self.recent.end - STILL_S
        period, even = _period(recent.time)
        moves, moved = even and self._surely_moves(recent, period), self._moved(recent) if even else -np.inf
        if moved > until and not moves:
            moves = not self._rests(recent, moved, period)
        if moves:
            until = max(until, moved)
        if until <= self._done or (not now and until < self._done + BATCH_S):
            return
        first, last = np.searchsorted(recent.time, [self._done, until], "right").tolist()
        if first == last:
            return
        if moves:
            part = recent.slice(first, last)
            self._hand_on(part)
            yield part, True
            return
        at_rest = self._at_rest(recent, slice(first, last), period)
        edges = [0, *self._turns(at_rest, recent.time[first:last]), last - first]
        for begin, end in pairwise(edges):
            part = recent.slice(first + begin, first + end)
            self._hand_on(part, self._rested_s + part.duration + period if at_rest[begin] else 0.0)
            yield part, not at_rest[begin]

    def _hand_on(self, samples: Recording, rested_s: float = 0.0) -> None:
        """Note that samples are handed on, and how long the joint has rested since its newest motion."""
        self._done, self._rested_s = float(samples.time[-1]), rested_s
        self._stood = {n: float(samples.channels[n][-1]) for n, _ in self._places(samples)} if rested_s else None
        self._fast = any(abs(samples.channels[name][-1]) > least for name, least in self._speeds(samples))

    def _speeds(self, samples: Recording) -> list[tuple[str, float]]:
        """Return the labels that show speed, each with the speed above which a sample belongs to no rest."""
        known = (self.noise or {}).items()
        return [(n, sure_speed(n, noise)) for n, noise in known if n in samples and n not in samples.derived]

    def _sure(self) -> Recording | None:
        """Return the samples after those that were handed on that belong to no rest, whatever follows."""
        if not self._fast or self._wound is not None:
            return None
        waiting, sure = self.recent.recording(math.nextafter(self._done, math.inf)), 0
        if not len(waiting):
            return None
        time = np.ascontiguousarray(waiting.time)
        for name, least in self._speeds(waiting):
            speed = np.ascontiguousarray(waiting.channels[name])
            sure = max(sure, int(compile_shared().moving(time, speed, self._done, least, STILL_S, EVEN)))
        if sure == len(waiting):  # nearly always
            return waiting
        return waiting.slice(0, sure) if sure else None

    def _stirs(self) -> bool:
        """Return whether the newest sample of a joint that rests may be in motion."""
        newest = self.recent.newest
        if self.noise is None:
            return False  # before the first estimate a motion may begin a tenth of a second late
        if newest is None or self._stood is None:
            return True
        far = [(newest.channels[n][-1], least) for n, least in self._speeds(newest)]
        far += [(newest.channels[n][-1] - self._stood.get(n, math.inf), least) for n, least in self._places(newest)]
        return not all(abs(value) <= least for value, least in far)  # nor is a missing one evidence of rest

    def _places(self, samples: Recording) -> list[tuple[str, float]]:
        """Return the labels that show position, each with a distance that is longer than any within a rest."""
        known = (self.noise or {}).items()
        return [
            (n, sure_distance(n, noise))
            for n, noise in known
            if n.endswith("_position") and n in samples and n not in samples.derived
        ]

    def _moved(self, recent: Recording) -> float:
        """Return the instant of the newest sample after which a rest that holds it cannot go on; -inf if there is none.

        It is faster than any of a rest, or the joint has since moved farther than in a rest. Whether it, or a sample
        before it, belongs to a rest does not depend on samples that are still to come.
        """
        if self._wound is not None:
            return -np.inf
        moved, rows = -np.inf, recent.channels
        far = [(np.abs(rows[n]), least) for n, least in self._speeds(recent)]
        far += [(np.abs(rows[n] - rows[n][-1]), least) for n, least in self._places(recent)]
        for size, least in far:
            found = np.flatnonzero(size > least)
            if len(found):
                moved = max(moved, float(recent.time[found[-1]]))
        return moved

    def _rests(self, recent: Recording, moved: float, period: float) -> bool:
        """Return whether a sample that was not handed on yet, up to an instant at which the joint `_moved`, rests."""
        labels = tuple(n for n in self._positions if n in recent and n not in recent.derived)
        y = np.array([recent.channels[n] for n in labels]).T
        new = (recent.time > self._done) & (recent.time <= moved)
        return not labels or bool(still(labels, y, period, self.noise)[new].any())

    def _surely_moves(self, recent: Recording, period: float) -> bool:
        """Return whether one label already tells that the joint moves at all samples."""
        if self.noise is None or self._wound is not None:
            return False
        known = ((n, sigma) for n, sigma in self.noise.items() if n in recent and n not in recent.derived)
        return any(surely_moves(name, recent.channels[name], period, sigma) for name, sigma in known)

    def _turns(self, at_rest: NDArray[np.bool_], time: Array) -> list[int]:
        """Return the numbers of the samples (T,) with which a rest, a motion, or what follows a pause begins."""
        gaps = pauses(time)
        changes = at_rest[1:] != at_rest[:-1]
        if not changes.any():  # nearly always
            return gaps.tolist() if len(gaps) else []
        return np.union1d(np.flatnonzero(changes) + 1, gaps).tolist()

    def _at_rest(self, recent: Recording, part: slice, period: float) -> NDArray[np.bool_]:
        """Return True for samples of a part at which the joint or its link rests."""
        labels = tuple(n for n in self._positions if n in recent and n not in recent.derived)
        if not labels or len(recent) < 2:
            return np.zeros(len(recent), dtype=bool)[part]
        y = np.array([recent.channels[n] for n in labels]).T
        rest = still(labels, y, period, self.noise)[part]
        if self._wound is None and not rest.any():
            return rest
        link_still = still_link(labels, y, period, self.noise)[part]
        rest, self._wound = wound_up(rest, link_still, period, self._wound)
        return rest


def _period(time: Array) -> tuple[float, bool]:
    """Return the typical step between instants (T,) in s, and whether all are nearly like it."""
    if len(time) < 2:
        return 0.0, False
    shortest, longest = extremes(time)
    if longest < EVEN * shortest:
        return float(time[-1] - time[0]) / (len(time) - 1), True
    steps = time[1:] - time[:-1]
    # A median, in a tenth of the time of `np.median`.
    return float(np.partition(steps, len(steps) // 2)[len(steps) // 2]), False
