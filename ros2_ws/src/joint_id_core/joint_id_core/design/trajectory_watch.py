"""What joints do while a motion is awaited: whether they move, for how long, and whether they follow the trajectory."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.trajectory import Trajectory

MOVED = 2e-3  # rad; by which a joint must move within `SPAN_S` to count as moving: far above the noise of an encoder
SPAN_S = 0.25
REST_S = 1.0  # of rest end a motion; a pause before it, and turns on the way, are shorter
WHOLE = 0.7  # share of a trajectory's duration from which a motion may be all of it: its soft ends look like rest
_MOST_OLD = 1000  # samples before the newest motion
_BEFORE_S, _AFTER_S, _STEP_S = 0.5, 2.0, 0.02  # where the end of a trajectory is looked for, around that of a motion


class TrajectoryWatch:
    """Positions of joints as they come, at any rate."""

    def __init__(self) -> None:
        self._time: list[float] = []
        self._position: list[Sequence[float]] = []
        self._first = 0.0  # time of the first sample; those before the newest motion are forgotten
        self._before = 0  # sample with which the newest is compared
        self._began = self._moved = -math.inf  # begin of the newest motion, newest instant at which joints moved

    def add(self, time: float, position: Sequence[float]) -> None:
        """Take the positions in rad, shape (joints,), at a time in s.

        Times that do not rise and positions that are not finite are left out.
        """
        if (self._time and time <= self._time[-1]) or not all(map(math.isfinite, position)):
            return
        if not self._time:
            self._first = time
        self._time.append(time)
        self._position.append(position)
        while self._time[self._before] < time - SPAN_S:
            self._before += 1
        before = self._position[self._before]
        if max(abs(q - p) for q, p in zip(position, before, strict=True)) > MOVED:
            if time - self._moved > REST_S:
                self._began = time
            self._moved = time
        self._forget()

    def _forget(self) -> None:
        """Forget what was before the newest motion, from time to time."""
        needed = self._time[self._before]
        if self._moved > -math.inf:
            needed = min(needed, self._began - REST_S)
        old = bisect.bisect_left(self._time, needed)
        if old > _MOST_OLD:
            del self._time[:old], self._position[:old]
            self._before -= old

    @property
    def moving(self) -> bool:
        """Whether joints move now."""
        return bool(self._time) and self._time[-1] - self._moved <= SPAN_S

    @property
    def rest_s(self) -> float:
        """How long the joints have been at rest, in s; 0 while they move."""
        return 0.0 if self.moving or not self._time else self._time[-1] - max(self._moved, self._first)

    @property
    def motion_s(self) -> float:
        """How long the newest motion has lasted, in s, without the rest after it; 0 if there was none."""
        return 0.0 if self._moved == -math.inf else self._moved - self._began

    def paused(self, trajectory: Trajectory) -> bool:
        """Return whether joints are at rest after a motion that is as long as a trajectory."""
        return self.rest_s > REST_S and self.motion_s > WHOLE * trajectory.duration

    def matched(self, trajectory: Trajectory) -> tuple[float, float]:
        """Return when the newest motion began to follow a trajectory, in s, and by how much it was off (rms, in rad).

        Args:
            trajectory: of the joints whose positions came, in their order.
        """
        time, position = np.array(self._time), np.array(self._position)
        instants = np.arange(0.0, trajectory.duration, 2.5 * _STEP_S)
        planned = trajectory.at(instants).position
        best = self._moved - trajectory.duration, math.inf
        for end in np.arange(self._moved - _BEFORE_S, self._moved + _AFTER_S, _STEP_S).tolist():
            begin = end - trajectory.duration
            recorded: Array = np.stack([np.interp(begin + instants, time, q) for q in position.T], axis=1)
            off = float(np.sqrt(np.mean(np.square(recorded - planned))))
            best = min(best, (begin, off), key=lambda found: found[1])
        return best
