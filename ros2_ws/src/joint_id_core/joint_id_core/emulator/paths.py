"""Paths of the emulated joints: the robot's own motion, a place, or a trajectory that it was given."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.simulation.excitation import position_reference

_DETOUR_S = 0.1  # s, time constant with which joints return to their own path after they were held elsewhere
# Of an arm, as in recordings made to identify one: its gears then yield little beside what they are accelerated.
# After a period it repeats, and tells nothing new.
_LOW_HZ, _HIGH_HZ, _PERIOD_S = 0.1, 1.0, 60.0
_APPROACH_SPEED = 0.3  # rad/s, peak of the fastest joint on the way to the start of a trajectory
_SHORTEST_APPROACH_S = 1.0  # longer than the robot takes to come to full speed on a path
_SETTLE_S = 0.5  # at the start of a trajectory


class Point(NamedTuple):
    """Position on a path, and its first two derivatives along it, each of shape (joints,), rad and s."""

    value: Array
    rate: Array
    curvature: Array


class Path(Protocol):
    """A path of all joints; `along` is the time in s that a robot at full speed has been on it."""

    def at(self, along: float) -> Point:
        """Return the point of the path there."""

    def resumed(self, along: float, q: Array) -> Path:
        """Return the path that joints take, after they were held at `q` in rad, shape (joints,)."""


class Rest:
    """Joints that stand at `q` in rad, shape (joints,)."""

    def __init__(self, q: Array) -> None:
        self._point = Point(q, np.zeros(len(q)), np.zeros(len(q)))

    def at(self, along: float) -> Point:
        """Return the place."""
        return self._point

    def resumed(self, along: float, q: Array) -> Path:
        """Return the new place."""
        return Rest(q)


class Multisines:
    """The robot's own motion: a multisine each.

    Args:
        home: centre of the motion in rad, by joint.
        moving: indices of the joints that move.
        amplitude: peak of the motion in rad.
        slow: whether the tones are those for an arm whose links act on each other.
    """

    def __init__(self, home: Sequence[float], moving: Collection[int], amplitude: float, slow: bool) -> None:
        peaks = [amplitude if j in moving else 0.0 for j in range(len(home))]
        band = {"low": _LOW_HZ, "high": _HIGH_HZ, "period": _PERIOD_S} if slow else {}
        waves = [position_reference(peak, **band, seed=1 + j) for j, peak in enumerate(peaks)]
        omega = 2.0 * math.pi * np.array(waves[0].frequencies)  # the same tones for every joint
        self._turn = 1j * omega
        self._phasors = np.array([w.amplitudes for w in waves]) * np.exp(1j * np.array([w.phases for w in waves]))
        self._derivatives = np.stack([np.ones_like(omega), 1j * omega, -(omega**2)], axis=1)
        self._home = np.array(home)
        self._left_at = 0.0  # where joints that were held elsewhere left for the path ...
        self._away = np.zeros(len(home))  # ... and how far away they were

    def at(self, along: float) -> Point:
        """Return the point of the path there, and what is left of a detour."""
        phasors = self._phasors * np.exp(self._turn * along)
        value, rate, curvature = (phasors @ self._derivatives).real.T
        detour = self._away * math.exp((self._left_at - along) / _DETOUR_S)
        return Point(self._home + value + detour, rate - detour / _DETOUR_S, curvature + detour / _DETOUR_S**2)

    def resumed(self, along: float, q: Array) -> Path:
        """Return the path with a detour from `q`."""
        self._left_at, self._away = along, np.zeros(len(q))
        self._away = q - self.at(along).value
        return self


class Followed:
    """A trajectory, after a slow way to its start; then the joints stand at its end.

    Attributes:
        approach_s: time in s until the trajectory begins.

    Args:
        trajectory: of some joints or all.
        columns: indices of these joints.
        q: present positions of all joints in rad, shape (joints,); joints that the trajectory does not move stay there.
    """

    def __init__(self, trajectory: Trajectory, columns: Sequence[int], q: Array) -> None:
        self._trajectory, self._columns, self._q = trajectory, list(columns), q
        self._begin = q.copy()
        self._begin[self._columns] = trajectory.position[0]
        # Peak speed of the quintic from rest to rest is 15/8 of the mean one.
        way = float(np.abs(self._begin - q).max())
        self._way_s = max(_SHORTEST_APPROACH_S, 1.875 * way / _APPROACH_SPEED)
        self.approach_s = self._way_s + _SETTLE_S

    def at(self, along: float) -> Point:
        """Return the point of the way or of the trajectory."""
        if along < self.approach_s:
            x = min(1.0, along / self._way_s)
            way = (self._begin - self._q) / self._way_s ** np.arange(3)[:, None]
            shape = (10 - 15 * x + 6 * x * x) * x**3, 30 * (x * (1 - x)) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
            value, rate, curvature = way * np.array(shape)[:, None]
            return Point(self._q + value, rate, curvature)
        state = self._trajectory.at(along - self.approach_s)
        point = Point(self._begin.copy(), np.zeros(len(self._q)), np.zeros(len(self._q)))
        for values, own in zip(point, state, strict=False):
            values[self._columns] = own[0]
        return point

    def resumed(self, along: float, q: Array) -> Path:
        """Return the place: who holds the joints elsewhere ends the motion."""
        return Rest(q)
