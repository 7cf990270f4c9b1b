"""Moves there and back along straight lines: how fast they may be, and where the joints are when.

Each move has a speed of its own. While it changes, the acceleration rises along a cubic step, is constant, and falls
along one, so the jerk has bounds and no jumps. Where the line is the same before and after a stop, the velocity goes
through zero in one such change, as in an oscillation: a joint that stands between its moves sticks, and what it shows
of its friction is lost. At a corner both velocity and acceleration become zero. So no move ever leaves the line.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.design.limits import JointLimits
from joint_id_core.errors import JointIdError

STEEPEST = 1.5  # largest slope of the cubic step 3 x^2 - 2 x^3, along which accelerations rise
_GRID = np.linspace(0.0, 1.0, 2**12 + 1)
_GAINS = _GRID**3 * (1.0 - _GRID / 2.0)  # its integral
_TRIES = 200  # to make speeds smaller until moves have room for their steps
FULL = 0.999  # share of the room that is used then


def step(y: Array, rise: Array) -> Array:
    """Return the integral of a step from 0 to 1, the step, and its first two derivatives, shape (4, n).

    Args:
        y: share of its time that is over, 0 to 1, shape (n,).
        rise: share of it in which the acceleration rises, and in which it falls, up to 0.5, shape (n,).
    """
    late = y > 0.5
    x = np.where(late, 1.0 - y, y)
    part, after, most = np.minimum(x / rise, 1.0), np.maximum(x - rise, 0.0), 1.0 / (1.0 - rise)
    way = most * (rise**2 * part**4 * (0.25 - 0.1 * part) + after * (rise + after) / 2.0)
    done = most * (rise * part**3 * (1.0 - 0.5 * part) + after)
    slope = most * part**2 * (3.0 - 2.0 * part)
    bend = np.where(x < rise, most / rise * 6.0 * part * (1.0 - part), 0.0)
    return np.array([np.where(late, y - 0.5 + way, way), np.where(late, 1.0 - done, done), slope,
                     np.where(late, -bend, bend)])  # fmt: skip


def inverse(share: Array, rise: Array) -> Array:
    """Return where steps (n,) with these shares of rise have the values `share`, 0 to 1."""
    late = share > 0.5
    part, most = np.where(late, 1.0 - share, share), 1.0 / (1.0 - rise)
    curved = rise * np.interp(part / (most * rise), _GAINS, _GRID)
    found = np.where(part < most * rise / 2.0, curved, rise / 2.0 + part / most)
    return np.asarray(np.where(late, 1.0 - found, found))


@dataclass(frozen=True, eq=False)
class Pace:
    """Limits of velocity, acceleration and jerk along lines, each of shape (lines,)."""

    velocity: Array
    acceleration: Array
    jerk: Array

    @classmethod
    def of(cls, directions: Array, limits: JointLimits, share: float = 1.0) -> Pace:
        """Return what so large a share of the limits allows along directions of length 1, shape (lines, joints)."""
        with np.errstate(divide="ignore"):
            found = [
                np.min(share * getattr(limits, k) / np.abs(directions), axis=1)
                for k in ("velocity", "acceleration", "jerk")
            ]
        return cls(*found)

    def slower(self, share: float | Array) -> Pace:
        """Return the pace at which all takes 1 / share as long."""
        return replace(
            self, velocity=share * self.velocity, acceleration=share**2 * self.acceleration, jerk=share**3 * self.jerk
        )

    def at(self, lines: NDArray[np.int64]) -> Pace:
        """Return the pace of some lines, shape (n,)."""
        return Pace(self.velocity[lines], self.acceleration[lines], self.jerk[lines])

    def step(self, change: Array, least: float) -> tuple[Array, Array]:
        """Return how long changes of speed (lines,) take in s, and the share of it in which accelerations rise.

        They rise for not less than `least` s.
        """
        quick = np.maximum(STEEPEST * self.acceleration / self.jerk, least)
        slow = np.maximum(np.sqrt(STEEPEST * change / self.jerk), least)  # acceleration never reaches its limit
        reached = change / self.acceleration > quick
        rise = np.where(reached, quick, slow)
        time = np.where(reached, change / self.acceleration + quick, 2.0 * slow)
        return time, rise / time

    def held(self, change: float, line: int) -> str:
        """Return which limit a change of speed reaches."""
        reached = change / self.acceleration[line] > STEEPEST * self.acceleration[line] / self.jerk[line]
        return "acceleration" if reached else "jerk"

    def alone(self, length: Array) -> Array:
        """Return a bit more than the largest speeds of moves of these lengths (lines,)."""
        return np.minimum.reduce(
            [self.velocity, np.sqrt(length * self.acceleration), np.cbrt(length**2 * self.jerk / 4.0)]
        )


@dataclass(frozen=True, eq=False)
class Steps:
    """Changes of speed at one end of moves, from the speed on the other side of the stop; each of shape (moves,).

    Attributes:
        change: of the speed: the sum of both.
        time: of the whole step in s.
        rise: see `step`.
        stop: share of the step at which the joints stand.
        part: time in s of the part of it that belongs to the move.
        way: of that part.
    """

    change: Array
    time: Array
    rise: Array
    stop: Array
    part: Array
    way: Array


@dataclass(frozen=True, eq=False)
class Moves:
    """Moves one after the other, from rest to rest.

    Attributes:
        length: of each, above 0, shape (moves,).
        turning: whether the next one goes back along the same line, shape (moves - 1,).
        pace: of the line of each.
        least: time in s that an acceleration rises at least.
    """

    length: Array
    turning: NDArray[np.bool_]
    pace: Pace
    least: float

    @cached_property
    def run(self) -> NDArray[np.int64]:
        """Number of the part from corner to corner that each is in, shape (moves,)."""
        return np.concatenate([[0], np.cumsum(~self.turning)])

    def steps(self, speed: Array) -> tuple[Steps, Steps]:
        """Return the changes of speed at the begin and at the end of each move."""
        before = np.concatenate([[0.0], np.where(self.turning, speed[:-1], 0.0)])
        after = np.concatenate([np.where(self.turning, speed[1:], 0.0), [0.0]])
        change = before + speed
        time, rise = self.pace.step(change, self.least)
        stop = inverse(before / change, rise)
        way = time * (change * (0.5 - step(stop, rise)[0]) - before * (1.0 - stop))
        begin = Steps(change, time, rise, stop, (1.0 - stop) * time, way)
        change = speed + after
        time, rise = self.pace.step(change, self.least)
        stop = inverse(speed / change, rise)
        way = time * (speed * stop - change * step(stop, rise)[0])
        return begin, Steps(change, time, rise, stop, stop * time, way)

    def timed(self, speed: Array) -> tuple[Array, Array]:
        """Return speeds at which the changes have room, these or smaller ones, and how long each move takes in s.

        Raises:
            JointIdError: there are none, which is a fault of this program.
        """
        for _ in range(_TRIES):
            begin, end = self.steps(speed)
            left = self.length - begin.way - end.way
            if left.min() >= 0.0:
                return speed, begin.part + left / speed + end.part
            used = (begin.way + end.way) / self.length
            speed = np.where(left < 0.0, speed * np.sqrt(FULL / used), speed)
        raise JointIdError("moves between waypoints leave no room for a change of speed: a fault of this program")

    def state(self, speed: Array, number: NDArray[np.int64], time: Array) -> Array:
        """Return way, velocity, acceleration and jerk along the moves, shape (4, n).

        Args:
            speed: of all moves, shape (moves,).
            number: of the move, shape (n,).
            time: since its begin in s, shape (n,).
        """
        begin, end = self.steps(speed)
        c, found = speed[number], np.zeros((4, len(time)))
        left = begin.part[number] + end.part[number] - time
        left += ((self.length - begin.way - end.way) / speed)[number]
        found[0] = begin.way[number] + c * (time - begin.part[number])
        found[1] = c
        for side, ends, past in ((begin, False, time), (end, True, left)):
            k = np.flatnonzero(past < side.part[number])
            own, sign = number[k], -1.0 if ends else 1.0
            change, whole, stop = side.change[own], side.time[own], side.stop[own]
            y = stop + sign * past[k] / whole
            rest = c[k] if ends else change - c[k]  # the speed before the step
            by, done, slope, bend = step(y, side.rise[own])
            gone = whole * np.abs(change * (by - step(stop, side.rise[own])[0]) - rest * (y - stop))
            found[0, k] = self.length[own] - gone if ends else gone
            found[1, k] = np.abs(change * done - rest)
            found[2, k] = sign * change * slope / whole
            found[3, k] = sign * change * bend / whole**2
        return found
