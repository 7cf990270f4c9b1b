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
        known = np.isfinite(part.y) & np.isfinite(part.columns).all(axis=2)
        fast = np.abs(np.nan_to_num(part.dq)) > MOVES
        breakaway = friction.breakaway(own[inertial.stop :], load)
        return cls(part.y, part.y - part.columns @ own, part.y - rigid, breakaway, part.used & fast, known & ~fast)

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
    """

    r_squared: Array
    in_band: Array
    resting: Array


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
    """Torque of each joint at rest: that of the links and its offset, plus and minus `factor` times the breakaway.

    Attributes:
        factor: at least 1, (n,).
        offsets: in Nm, the means over the recordings, (n,).
        rest_s: how long each joint rested in them, in s, (n,); below `LEAST_S` its factor is 1.
    """

    factor: Array
    offsets: Array
    rest_s: Array

    @classmethod
    def of(cls, lefts: Sequence[Left]) -> Band:
        """Return the narrowest one that holds `SHARE` of the rests of some recordings, and whole breakaways."""
        count = lefts[0].torque.shape[1]
        all_offsets = np.array([left.offsets(np.full(count, np.nan)) for left in lefts])
        known = np.isfinite(all_offsets)
        offsets = np.where(known, all_offsets, 0.0).sum(axis=0) / np.maximum(1, known.sum(axis=0))
        factor, rest_s = np.ones(count), np.zeros(count)
        sizes = [_sizes(left, offsets) for left in lefts]
        for j in range(count):
            ratios = np.concatenate([some[j] for some in sizes])
            rest_s[j] = len(ratios) * KEPT / RATE
            if rest_s[j] >= LEAST_S:
                factor[j] = max(1.0, float(np.quantile(ratios, SHARE)))
        return cls(factor, offsets, rest_s)

    def holds(self, left: Left) -> Array:
        """Return the share of the rests of each joint that it holds, (n,); NaN where it does not rest."""
        sizes = _sizes(left, self.offsets)
        return np.array([float(np.mean(s <= f)) if len(s) else np.nan for s, f in zip(sizes, self.factor, strict=True)])


def _sizes(left: Left, offsets: Array) -> list[Array]:
    """Return by joint the sizes of what is left at rest, as shares of the breakaway; none if friction is not known."""
    away, known = np.abs(left.resting - left.offsets(offsets)), left.rests & (left.breakaway > 0.0)
    return [a[w] / b[w] for a, b, w in zip(away.T, left.breakaway.T, known.T, strict=True)]
