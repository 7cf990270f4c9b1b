"""The newest samples of a joint, in motion or at rest."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.shared.computed_load import where_known
from joint_id_core.estimators.shared.stillness import STILL_S, still, still_link, surely_moves, wound_up
from joint_id_core.models import Model
from joint_id_core.online.window import SlidingWindow, extremes, pauses

MOVED_S = 0.5  # a joint counts as moving until it has been seen at rest for so long; a pause of the samples is no rest
EVEN = 1.5  # largest over smallest step of samples that come without gaps
BATCH_S = 0.1  # of samples that are handed on together: the work on a batch hardly depends on its length


class MotionWatch:
    """Takes samples and hands them on as stretches of motion and of rest.

    The newest `STILL_S` wait: whether they belong to a rest shows a little later.

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
        until = self.recent.end - STILL_S
        if not now and until < self._done + BATCH_S:
            return
        recent = self.recent.recording(self._done - 2.0 * STILL_S)
        first, last = np.searchsorted(recent.time, [self._done, until], "right").tolist()
        if first == last:
            return
        self._done = float(recent.time[last - 1])
        period, even = _period(recent.time)
        if even and self._surely_moves(recent, period):  # nearly always
            yield recent.slice(first, last), True
            self._rested_s = 0.0
            return
        at_rest = self._at_rest(recent, slice(first, last), period)
        edges = [0, *self._turns(at_rest, recent.time[first:last]), last - first]
        for begin, end in pairwise(edges):
            part = recent.slice(first + begin, first + end)
            yield part, not at_rest[begin]
            self._rested_s = self._rested_s + part.duration + period if at_rest[begin] else 0.0

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
