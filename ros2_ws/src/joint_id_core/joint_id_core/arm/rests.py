"""What a fit of an arm says of recordings, rest and motion apart.

A joint in motion has the friction of its law. One that rests, or turns, has any between minus and plus that of its
breakaway: what was before decides, and a law without memory cannot tell (Armstrong-Helouvry, Dupont & Canudas de Wit,
Automatica 30, 1994). So its torque is predicted as a band: that of the links, plus and minus friction at standstill. It
is wider where the recorded rests say so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.equations import KEPT, PAYLOAD, RATE, Equations
from joint_id_core.arm.friction import Friction
from joint_id_core.arm.stacked import centred
from joint_id_core.data.recording import Array

MOVES = 0.02  # rad/s: above it friction has turned after a reversal, and gears do not yield any more
SHARE = 0.95  # of rests that a band holds
NOISE = 2.0  # standard deviations of what is left in motion, by which a band is wider: it is there at rest, too
LEAST_R_SQUARED = 0.9  # of the torque of a joint
LEAST_S = 2.0  # of rest: less tells nothing of what a joint holds


@dataclass(frozen=True)
class Left:
    """What a fit leaves of the torques of n joints at R instants.

    Attributes:
        torque: that was recorded, (R, n).
        moving: of it by the whole law, (R, n).
        resting: of it without friction, (R, n).
        breakaway: friction at standstill in Nm at the load of the instant, (R, n).
        moves, rests: where each joint does so, and all is known, (R, n).
    """

    torque: Array
    moving: Array
    resting: Array
    breakaway: Array
    moves: NDArray[np.bool_]
    rests: NDArray[np.bool_]

    @classmethod
    def of(cls, part: Equations, friction: Friction, values: Array) -> Left:
        """Return it from equations with all columns, and the values of all of them, those of the payload included."""
        own = values.copy()
        own[part.base : part.base + PAYLOAD] *= part.loaded
        inertial = slice(0, part.base + PAYLOAD)
        rigid = part.columns[:, :, inertial] @ own[inertial]
        load = np.abs(part.columns[:, :, inertial] @ friction.of(part))
        fast = np.abs(np.nan_to_num(part.dq)) > MOVES
        breakaway = friction.breakaway(own[inertial.stop :], load)
        return cls(part.y, part.y - part.columns @ own, part.y - rigid, breakaway, part.used & fast, part.rests)

    def offsets(self, otherwise: Array) -> Array:
        """Return the torque offset of each joint, (n,): the mean of what is left in motion; `otherwise` without."""
        return np.array(
            [m[w].mean() if w.any() else o for m, w, o in zip(self.moving.T, self.moves.T, otherwise, strict=True)]
        )


@dataclass(frozen=True)
class HeldOut:
    """How another recording is predicted, by joint, (n,).

    Attributes:
        r_squared: share of the torque that is explained in motion; NaN without.
        in_band: share of the rests that the band holds; NaN without.
        resting: share of the time in which the joint rests.
        worse: rms of what is left of the torque in motion, over that of the fit; NaN without.
    """

    r_squared: Array
    in_band: Array
    resting: Array
    worse: Array


def explained(lefts: Sequence[Left]) -> Array:
    """Return the share of the torque of each joint about its mean that is explained in motion, (n,); NaN without."""
    found = []
    for j in range(lefts[0].torque.shape[1]):
        left, spread = (
            sum(float(np.sum(centred(values[part.moves[:, j], j]) ** 2)) for part, values in pairs)
            for pairs in ([(p, p.moving) for p in lefts], [(p, p.torque) for p in lefts])
        )
        found.append(1.0 - left / spread if spread > 0.0 else np.nan)
    return np.array(found)


@dataclass(frozen=True)
class Band:
    """Torque of each joint at rest: that of the links and its offset, ± `factor` times the breakaway and `noise`.

    Attributes:
        factor: at least 1, of all joints: one joint alone rests too seldom to tell.
        noise: twice the standard deviation of what is left of the torque in motion, in Nm, (n,).
        offsets: in Nm, the means over the recordings, (n,).
        rest_s: how long each joint rested in them, in s, (n,).
    """

    factor: float
    noise: Array
    offsets: Array
    rest_s: Array

    @classmethod
    def of(cls, lefts: Sequence[Left]) -> Band:
        """Return the narrowest one that holds breakaways, and `SHARE` of the torque in `SHARE` of recorded rests."""
        count = lefts[0].torque.shape[1]
        all_offsets = np.array([left.offsets(np.full(count, np.nan)) for left in lefts])
        known = np.isfinite(all_offsets)
        offsets = np.where(known, all_offsets, 0.0).sum(axis=0) / np.maximum(1, known.sum(axis=0))
        noise = NOISE * np.sqrt(np.array([_mean_square(lefts, j) for j in range(count)]))
        sizes = [_sizes(left, offsets, noise) for left in lefts]
        each = [float(np.quantile(rest, SHARE)) for some in sizes for joint in some for rest in joint]
        rest_s = np.array([sum(left.rests[:, j].sum() for left in lefts) * KEPT / RATE for j in range(count)])
        factor = float(np.quantile(each, SHARE, method="higher")) if each else 1.0
        return cls(max(1.0, factor), noise, offsets, rest_s)

    def worse(self, left: Left) -> Array:
        """Return the rms of what is left of the torque of each joint in motion over that of the fit, (n,)."""
        own = NOISE * np.sqrt([_mean_square([left], j) for j in range(len(self.noise))])
        return np.where((self.noise > 0.0) & (own > 0.0), own / np.where(self.noise > 0.0, self.noise, 1.0), np.nan)

    def width(self, breakaway: Array) -> Array:
        """Return half of its width in Nm at friction at standstill, (n,); 0 where that is not known."""
        return np.where(breakaway > 0.0, self.factor * breakaway + self.noise, 0.0)

    def holds(self, left: Left) -> Array:
        """Return the share of the time at rest of each joint in which it holds, (n,); NaN where it does not rest."""
        sizes = [np.concatenate([*rests, []]) for rests in _sizes(left, self.offsets, self.noise)]
        return np.array([float(np.mean(some <= self.factor)) if len(some) else np.nan for some in sizes])


def _mean_square(lefts: Sequence[Left], j: int) -> float:
    """Return the mean square in Nm^2 of what is left of the torque of a joint in motion; 0 if it does not move."""
    left = np.concatenate([centred(part.moving[part.moves[:, j], j]) for part in lefts])
    return float(left @ left) / max(1, len(left))


def _sizes(left: Left, offsets: Array, noise: Array) -> list[list[Array]]:
    """Return by joint and rest what is left beyond the noise over the breakaway; none if friction is not known."""
    away = np.abs(left.resting - left.offsets(offsets)) - noise
    known = left.rests & (left.breakaway > 0.0)
    found = []
    for a, b, w in zip(away.T, left.breakaway.T, known.T, strict=True):
        rows = np.flatnonzero(w)
        rests = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
        found.append([a[rest] / b[rest] for rest in rests if len(rest)])
    return found
