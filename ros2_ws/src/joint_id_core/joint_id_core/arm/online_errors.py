"""What computed loads may be off by, for the samples of all joints of an arm as they arrive."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.load_errors import RATE_HZ, Errors, errors_of
from joint_id_core.arm.motion import motion
from joint_id_core.data.load_errors import FAR_S, SampledErrors, distances
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.computed_load import computed

POSITION = "link_position"
KEPT_S = 1200.0  # of the positions of an arm
SETTLED_S = 1.0  # before and after instants, so that derivatives are known there


class OnlineErrors:
    """Keeps the newest positions of an arm, and tells what they say of the loads when that is asked for.

    Fits of whole windows ask for it, from time to time, in threads of their own.
    """

    def __init__(self, description: Description) -> None:
        """Prepare, which takes a tenth of a second a joint."""
        self._positions, errors = _Positions(description.joints), errors_of(description)
        joints = [] if errors is None else [name for name in description.joints if _has_load(description, name)]
        if errors is not None:
            errors.prepare(joints)
            joints = [name for name in joints if errors.any_of(name)]
        self._of = {name: _JointErrors(errors, self._positions, name) for name in joints if errors is not None}

    def attached(self, recordings: Mapping[str, Recording]) -> dict[str, Recording]:
        """Take the newest samples of joints, by name; return them with what their load may be off by.

        Those whose load was not computed, and all if the position of a joint of the description is missing, stay as
        they are.
        """
        found = dict(recordings)
        loaded = [name for name in self._of if name in found and computed(found[name])]
        if loaded and self._positions.add(found):
            for name in loaded:
                found[name] = found[name].with_load_errors(self._of[name])
        return found


class _Positions:
    """The newest positions of the joints of an arm."""

    def __init__(self, joints: tuple[str, ...]) -> None:
        self.joints, self.run = joints, 0
        self._parts = deque[tuple[Array, Array]]()  # instants, and positions of all joints
        self._every, self._next = 1, 0  # sample of the arriving ones that is kept, and the first one of the next

    def add(self, recordings: Mapping[str, Recording]) -> bool:
        """Take new ones; return whether those of all joints are there, at the same instants."""
        there = [recordings.get(name) for name in self.joints]
        known = [one for one in there if one is not None and POSITION in one]
        if len(known) < len(there) or not all(np.array_equal(one.time, known[0].time) for one in known):
            return False
        time = known[0].time
        if self._parts and time[0] <= self._parts[-1][0][-1]:
            self._parts, self.run = deque(), self.run + 1
        if len(time) > 1:
            self._every = max(1, round(1.0 / (RATE_HZ * known[0].period)))
        rows = np.arange(min(self._next, self._every - 1), len(time), self._every)
        self._next = int(rows[-1]) + self._every - len(time) if len(rows) else self._next - len(time)
        if len(rows):
            self._parts.append((time[rows], np.column_stack([one[POSITION][rows] for one in known])))
        while self._parts and self._parts[-1][0][-1] - self._parts[0][0][-1] > KEPT_S:
            self._parts.popleft()
        return True

    def between(self, begin: float, end: float) -> tuple[Array, Array]:
        """Return instants (S,) and positions (S, n)."""
        parts = [part for part in self._parts.copy() if part[0][-1] >= begin and part[0][0] <= end]
        if not parts:
            return np.zeros(0), np.zeros((0, len(self.joints)))
        time, positions = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return time, positions


class _JointErrors:
    """Errors of the load of a joint of an arm whose positions are kept."""

    def __init__(self, errors: Errors, positions: _Positions, name: str) -> None:
        self._errors, self._positions, self._name = errors, positions, name
        self.of = errors.of(name)
        self._last: tuple[int, float, float, SampledErrors] | None = None

    def at(self, time: Array) -> Array:
        """See `LoadErrors`."""
        begin, end, run, last = float(time[0]), float(time[-1]), self._positions.run, self._last
        # The same window is asked for some times.
        if last is None or last[0] != run or not last[1] <= begin <= end <= last[2]:
            last = self._last = run, begin - FAR_S, end + FAR_S, self._sampled(time)
        return last[3].at(time)

    def _sampled(self, time: Array) -> SampledErrors:
        """Return the errors at the samples near some instants (T,)."""
        joints = self._positions.joints
        known, positions = self._positions.between(float(time[0]) - SETTLED_S, float(time[-1]) + SETTLED_S)
        if len(known) < 2:
            return self._errors.along([self._name], known, (positions, positions, positions))[self._name]
        moved = {name: Recording(known, {POSITION: positions[:, k]}) for k, name in enumerate(joints)}
        q, dq, ddq = motion(moved, joints, moved[joints[0]], self.of)
        near = distances(known, time) < FAR_S
        return self._errors.along([self._name], known[near], (q[near], dq[near], ddq[near]))[self._name]


def _has_load(description: Description, joint: str) -> bool:
    try:
        description.require(joint)
    except JointIdError:
        return False
    return True
