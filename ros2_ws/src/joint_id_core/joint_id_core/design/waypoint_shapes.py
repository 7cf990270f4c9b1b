"""Ways through waypoints as shapes of a motion: there and back along the list, as often as the time allows.

A shape says how often, how fast each way is passed, and on which ways the joints turn back for a while. It takes the
whole time that is asked. Every corner is at a sample, so that what a controller makes of the samples stays on the
straight lines, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.moves import Moves, Pace
from joint_id_core.design.search import MARGIN, Sized
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.waypoints import ALIKE, Waypoints
from joint_id_core.errors import JointIdError

LEAST_SAMPLES = 8  # in which an acceleration rises: what a controller makes of fewer would break limits between them
SLOWEST = 3.0  # logarithm of how much slower than the quickest moves others of random shapes are, at most
TURNS = 0.7  # share of the ways on which random shapes turn back, at most
LEAST_PART = 0.15  # of a way, between two turns
FULL_SPEED = 0.99  # share of the limit of velocity that reaches it
BY_TORQUE = 0.75  # power of the scale by which all is slower: accelerations fall by 1.5, as friction does not fall
HIGHER = 1.05  # than the scale of the last shape is the first one of the next
HALVINGS = 20  # of the interval in which the common factor of the speeds is looked for


@dataclass(frozen=True)
class Ways:
    """A shape.

    Attributes:
        speeds: logarithms of the speeds of the up to three moves of each way, up to a common factor, (ways, 3).
        turns: shares of each way at which the joints turn back and forth again, (ways, 2); NaN where they do not.
    """

    speeds: Array
    turns: Array


@dataclass(frozen=True)
class Timed:
    """Moves that take the whole time.

    Attributes:
        moves, speed: as in `moves`.
        way: number in the round of the way that each is on, shape (moves,).
        begin, sign: where on it they begin, as a length, and whether they go forth (1) or back (-1), shape (moves,).
        start, longer: number of the sample at which each begins, which may be no whole one, and how many times as long
            as with these speeds it takes, shape (moves,).
        held: what limits the fastest one.
    """

    moves: Moves
    speed: Array
    way: NDArray[np.int64]
    begin: Array
    sign: Array
    start: Array
    longer: Array
    held: str


class WaypointShapes:
    """Ways of one or several joints through waypoints.

    Args:
        waypoints: of these joints.
        limits: of the same joints, without infinite ones but for the torque.
        duration: of the motion in s.
        rate: samples a second.
        slower: share of the pace of the limits of each way from one `stop` to the next, as torques need it; None: 1.

    Raises:
        JointIdError: a waypoint outside the limits; not even one round in this time.
    """

    def __init__(
        self, waypoints: Waypoints, limits: JointLimits, duration: float, rate: float, slower: Array | None = None
    ) -> None:
        waypoints.require_within(limits)
        self.lower, self.upper = waypoints.points.min(axis=0), waypoints.points.max(axis=0)
        self.names, self._source = waypoints.names, waypoints.source
        self._rate, self._samples, self._least_rise = rate, round(duration * rate), LEAST_SAMPLES / rate
        points = waypoints.points[waypoints.stops]
        there = np.diff(points, axis=0)
        self._from, ways = np.concatenate([points[:-1], points[:0:-1]]), np.concatenate([there, -there[::-1]])
        self._length = np.linalg.norm(ways, axis=1)
        self._direction = ways / self._length[:, None]
        pace = Pace.of(self._direction, limits, MARGIN)
        self._pace = pace if slower is None else pace.slower(np.concatenate([slower, slower[::-1]]))
        self._turning = np.abs(self._direction + np.roll(self._direction, -1, axis=0)).max(axis=1) < ALIKE
        self.round, self.most, self._scale = len(ways), 1, 1.0
        if (least := self._least(self.plain(1))) > self._samples:
            raise JointIdError(
                f"{waypoints.source}: there and back through {len(waypoints.points)} waypoints takes "
                f"{least / rate:.3g} s within the limits ({limits.source}), and the motion has {duration:g} s: give "
                "more time (--time), fewer or nearer waypoints, or wider limits"
            )
        self.most = max(1, int(self._samples / least))

    def plain(self, rounds: int) -> Ways:
        """Return some rounds at one speed, or the largest where that is less, without a turn."""
        count = rounds * self.round
        alike = Ways(np.zeros((count, 3)), np.full((count, 2), np.nan))
        moves, *_ = self._moves(alike, 1.0)
        largest, _ = moves.timed(moves.pace.alone(moves.length))
        return Ways(-np.log(np.tile(largest[:, None], (1, 3))), alike.turns)

    def random(self, rng: np.random.Generator) -> Ways:
        """Return some rounds, few as likely as many, with a part of the moves as quick as possible."""
        count = self.round * int(np.exp(rng.uniform(0.0, np.log(self.most + 1))))
        quick = rng.random((count, 3)) < rng.random()
        speeds = np.where(quick, 0.0, -SLOWEST * rng.random((count, 3)))
        turning = rng.random(count) < rng.uniform(0.0, TURNS)
        return self._fitting(Ways(speeds, _turns(turning, rng)), 1.0)

    def changed(self, shape: Ways, size: float, rng: np.random.Generator) -> Ways:
        """Return the ways at other speeds, with other turns, and now and then one round more or less."""
        speeds, turns, count = shape.speeds.copy(), shape.turns.copy(), len(shape.speeds)
        if rng.random() < 0.25:
            at = self.round * int(rng.integers(count // self.round))
            rows = np.arange(count)
            if rng.random() < 0.5:
                rows = np.insert(rows, at, rows[at : at + self.round])
            elif count > self.round:
                rows = np.delete(rows, np.s_[at : at + self.round])
            speeds, turns, count = speeds[rows], turns[rows], len(rows)
        speeds += SLOWEST * size * (rng.random(speeds.shape) < 0.5) * rng.standard_normal(speeds.shape)
        other = rng.random(count) < 0.3 * size
        turns[other] = _turns(rng.random(count) < 0.5, rng)[other]
        return self._fitting(Ways(speeds, turns), 1.0)

    def sized(self, shape: Ways) -> Sized:
        """Return a shape within the limits; its scale is about the share of the torque that they allow.

        Where torques did not allow the last shapes, it is little above what they did.
        """
        first = self._scale = min(1.0, HIGHER * self._scale)

        def at(scale: float) -> tuple[Array, Array]:
            self._scale = min(self._scale, scale)
            position, velocity = self.state(shape, scale)[:2]
            return position[:, 0].copy(), velocity[:, 0].copy()

        return Sized(at, first, self._timed(shape, 1.0).held if first == 1.0 else "torque")

    def beyond(self, shape: Ways, scale: float) -> None:
        """Return nothing: the waypoints say how far the joints go."""

    def trajectory(self, shape: Ways, scale: float, name: str = "") -> Trajectory:
        """Return the motion."""
        position, velocity, acceleration, _ = self.state(shape, scale)
        time = np.arange(self._samples + 1) / self._rate
        return Trajectory((name,) if name else self.names, time, position, velocity, acceleration)

    def state(self, shape: Ways, scale: float = 1.0, samples: NDArray[np.int64] | None = None) -> Array:
        """Return position, velocity, acceleration and jerk, shape (4, T, joints), at all samples or those of numbers.

        Raises:
            JointIdError: at this scale not even one round fits in the time.
        """
        timed = self._timed(self._fitting(shape, scale), scale)
        k = np.arange(self._samples + 1) if samples is None else samples
        own = np.searchsorted(timed.start, k, side="right") - 1
        longer = timed.longer[own]
        along = timed.moves.state(timed.speed, own, (k - timed.start[own]) / (self._rate * longer))
        along *= timed.sign[own] / longer ** np.arange(4)[:, None]
        along[0] = timed.begin[own] + along[0]
        way = timed.way[own]
        found = along[:, :, None] * self._direction[way]
        found[0] += self._from[way]
        return found

    def told(self, shape: Ways, scale: float = 1.0) -> tuple[str, ...]:
        """Return as sentences how the motion goes through the waypoints."""
        shape = self._fitting(shape, scale)
        timed, count = self._timed(shape, scale), len(shape.speeds)
        times = timed.moves.timed(timed.speed)[1] * timed.longer
        turning = int(np.count_nonzero(~np.isnan(shape.turns[:, 0])))
        back = f", and turns back for a while on {turning} of {count} ways" if turning else ""
        often = "once" if count == self.round else f"{count // self.round} times"
        return (
            f"It goes {often} through the waypoints of {self._source} and back, in moves of {times.min():.2g} to "
            f"{times.max():.2g} s{back}.",
            "It stays on the straight lines, in angles of the joints, between neighbours in that list: that these are "
            "free of collisions only you know.",
        )

    def _fitting(self, shape: Ways, scale: float) -> Ways:
        """Return the shape with as many of its turns, from the first on, and then of its rounds, as the time allows."""
        speeds, turns = shape.speeds, shape.turns.copy()
        while self._least(Ways(speeds, turns), scale) > self._samples:
            turning = np.flatnonzero(~np.isnan(turns[:, 0]))
            if len(turning):
                turns[turning[len(turning) // 2 :]] = np.nan
            elif len(speeds) > self.round:
                speeds, turns = speeds[: -self.round], turns[: -self.round]
            else:
                raise JointIdError("the joints cannot move as slowly as that and come back in time")
        return Ways(speeds, turns)

    def _least(self, shape: Ways, scale: float = 1.0) -> int:
        """Return how many periods a shape takes at the largest speeds."""
        moves, *_ = self._moves(shape, scale)
        return int(self._periods(moves, moves.timed(moves.pace.alone(moves.length))[1]).sum())

    def _moves(self, shape: Ways, scale: float) -> tuple[Moves, NDArray[np.int64], Array, Array, Array]:
        """Return the moves of a shape, their ways, where on them they begin and end, the logarithms of the speeds."""
        count = len(shape.speeds)
        turning = ~np.isnan(shape.turns[:, 0])
        stops = np.column_stack([np.zeros(count), shape.turns, np.ones(count)])
        used = np.column_stack([np.ones(count, dtype=bool), turning, turning])
        way = np.tile(np.arange(count)[:, None] % self.round, (1, 3))[used]
        begin, end = stops[:, :3][used], np.where(turning[:, None], stops[:, 1:], 1.0)[used]
        begin, end = begin * self._length[way], end * self._length[way]
        back = (end[:-1] != self._length[way[:-1]]) | self._turning[way[:-1]]
        moves = Moves(np.abs(end - begin), back, self._pace.at(way).slower(scale**BY_TORQUE), self._least_rise)
        return moves, way, begin, end, shape.speeds[used]

    def _periods(self, moves: Moves, times: Array) -> NDArray[np.int64]:
        """Return how many periods moves that take so many s take from corner to corner."""
        return np.ceil(np.bincount(moves.run, times) * self._rate - 1e-9).astype(np.int64)

    def _timed(self, shape: Ways, scale: float) -> Timed:
        """Return the moves of a shape that fits the time, as slow as that is long."""
        moves, way, begin, end, logarithm = self._moves(shape, scale)
        most, _ = moves.timed(moves.pace.alone(moves.length))

        def at(factor: float) -> tuple[Array, Array]:
            return moves.timed(most * np.minimum(1.0, np.exp(logarithm + factor)))

        slow, fast = -logarithm.max() - 10.0, -logarithm.min()
        for _ in range(HALVINGS):
            middle = (slow + fast) / 2.0
            late = self._periods(moves, at(middle)[1]).sum() > self._samples
            slow, fast = (middle, fast) if late else (slow, middle)
        speed, times = at(fast)
        run, samples = moves.run, self._periods(moves, times)
        left = self._samples - int(samples.sum())
        samples += left // len(samples)
        samples[: left % len(samples)] += 1
        longer = (samples / (np.bincount(run, times) * self._rate))[run]
        start = np.concatenate([[0.0], np.cumsum(times * longer * self._rate)[:-1]])
        first = np.searchsorted(run, run)  # of the run, which begins at a whole sample
        start += (np.cumsum(samples) - samples)[run] - start[first]
        k = int(np.argmax(speed / moves.pace.velocity))
        held = "velocity" if speed[k] > FULL_SPEED * moves.pace.velocity[k] else moves.pace.held(speed[k], k)
        return Timed(moves, speed, way, begin, np.sign(end - begin), start, longer, held)


def _turns(turning: NDArray[np.bool_], rng: np.random.Generator) -> Array:
    """Return turns at random where there shall be some, shape (n, 2)."""
    first = rng.uniform(2.0 * LEAST_PART, 1.0, len(turning))
    second = first - LEAST_PART - rng.random(len(turning)) * (first - 2.0 * LEAST_PART)
    return np.where(turning[:, None], np.array([first, second]).T, np.nan)
