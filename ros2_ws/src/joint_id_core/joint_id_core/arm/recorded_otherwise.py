"""Whether an arm was recorded otherwise than it moves: joints exchanged, turned, in another unit, or with another zero.

All joints bear the same links. So one wrong column pulls masses and rotors of all away, while each joint may seem to be
explained. A guess that is right leaves much less of all torques, and less than a base that leans, which `suspects`
tell: with that, a vertical axis bears gravity, which a larger torque of it would explain in part.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial.transform import Rotation

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import Equations
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.rests import LEAST_R_SQUARED
from joint_id_core.arm.tested_faults import UNIT
from joint_id_core.arm.torque_sums import ALL, Explained, Guess, Moved, TorqueSums
from joint_id_core.data.recording import Array

# By how much the logarithm of the likelihood rises: a Bayes factor of a million with a memory of four equations, and
# what is left falls by 2 % in the mean. Of a UR10e a factor on its last joint, which nothing shows, makes up to 0.4 %.
CLEAR, FALLS = 40.0, 0.02
# A factor on all torques is one on all masses: those of a description are far off where they hold the place of unknown
# ones, and then not even the fifth part.
FAR_OF_ALL = math.log(30.0)
FAR = math.log(1.4)  # factor of a torque that no uncertainty of a torque constant makes
STEP, MOST = 0.35, 10.0  # of the logarithms of factors that are tried one after the other, and the largest one
PATIENCE = 4.5  # steps that are tried beyond the best one
FAULTS = 3  # that are sought one after the other
DEGREES, MILLIMETRES = math.pi / 180.0, 1e-3
LEANS = math.radians(30.0)  # the most that a base leans by; beyond, gravity acts elsewhere
LEANING = math.radians(3.0)  # from which its angle is sought
OFF = math.radians(15.0)  # a zero that is off by less is told by `suspects`, and in the intervals
TURNS, THINNED = 8, 4  # zeros that are tried, and share of the instants at which they are


@dataclass(frozen=True)
class _Tried:
    """A guess, what it leaves, and the fault in words."""

    found: Explained
    sums: TorqueSums
    guess: Guess
    moved: Moved
    text: str

    @property
    def explained(self) -> bool:
        """Whether the torques of all joints that move are."""
        return not np.any(self.found.r_squared <= LEAST_R_SQUARED)


def recorded_otherwise(
    description: Description, regressor: Regressor, parts: Sequence[Equations], beforehand: Beforehand | None = None
) -> str:
    """Return how an arm seems to have been recorded, in words; empty if nothing explains its torques far better.

    Args:
        description: of the arm; `regressor`: of it.
        parts: equations of recordings without a payload.
        beforehand: what is known of its links; without, it is made.
    """
    search = _Search(description, regressor, beforehand or Beforehand.of(regressor))
    moved, texts = Moved.of(parts), list[str]()
    if not len(moved.q):
        return ""
    best = search.begin(moved)
    least = max(CLEAR, FALLS * float(best.sums.counts.sum()))
    while len(texts) < FAULTS and (not texts or not best.explained):
        better = [one for one in search.others(best) if best.found.left - one.found.left > least]
        if not better:
            break
        found = min(better, key=lambda one: one.found.left)
        if search.leaning(best) - found.found.left < CLEAR:
            break
        best = found
        alike = [one for one in better if one.found.left - best.found.left < CLEAR and one is not best]
        texts.append(", or ".join(one.text for one in (best, *alike)))
    return "; ".join(texts) if best.explained else ""


@dataclass(frozen=True)
class _Search:
    """Guesses with one more fault."""

    description: Description
    regressor: Regressor
    beforehand: Beforehand

    def begin(self, moved: Moved) -> _Tried:
        """Return what is left as it was recorded."""
        return self._of(moved, Guess.as_recorded(len(self.regressor.joints)), "")

    def others(self, now: _Tried) -> Iterator[_Tried]:
        """Give guesses."""
        moves = np.flatnonzero(now.sums.counts).tolist()
        if abs(log := _size(now.sums, now.guess, ALL)) > FAR_OF_ALL:
            text = f"the torques of all joints seem to be far too {_than(log)} for the masses of the description (unit)"
            yield _with(now, now.guess.scaled(ALL, math.exp(log)), text)
        for j in moves:
            yield from self._of_torque(now, j)
            yield from self._of_position(now, j)
        for i, j in combinations(moves, 2):
            yield from self._exchanged(now, i, j)

    def leaning(self, now: _Tried) -> float:
        """Return what is left if the base leans, about the axis and by the angle that leave least."""
        down, thinned = self.description.gravity, now.moved.thinned(THINNED)
        if not down.any():
            return math.inf
        across = np.linalg.svd(down[None])[2][1:]

        def left(angles: Array, moved: Moved) -> float:
            turned = Rotation.from_rotvec(angles @ across).apply(down)
            description = Description(self.description.text, self.description.source, turned.tolist())
            regressor = Regressor(description)
            search = _Search(description, regressor, Beforehand.of(regressor))
            return search._of(moved, now.guess, "").found.left

        corners = LEANING * np.array([[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]])
        found = minimize(  # type: ignore[call-overload]  # its stub knows no simplex
            lambda angles: left(np.clip(angles, -LEANS, LEANS), thinned), corners[0], method="Nelder-Mead",
            options={"xatol": 0.003, "fatol": 1.0, "initial_simplex": corners},
        )  # fmt: skip
        return left(np.clip(found.x, -LEANS, LEANS), now.moved)

    def _of(self, moved: Moved, guess: Guess, text: str) -> _Tried:
        sums = TorqueSums.of(self.regressor, moved, self.beforehand)
        return _Tried(sums.explained(guess), sums, guess, moved, text)

    def _of_torque(self, now: _Tried, j: int) -> Iterator[_Tried]:
        """Give guesses about the torque of a joint."""
        torque = f"the torque of {self.regressor.joints[j]} seems to"
        yield _with(now, now.guess.scaled(j, -1.0), f"{torque} have the other sign")
        if abs(log := _size(now.sums, now.guess, j)) > FAR:
            text = f"{torque} be {math.exp(abs(log)):.2g} times too {_than(log)} {UNIT}"
            yield _with(now, now.guess.scaled(j, math.exp(log)), text)

    def _of_position(self, now: _Tried, j: int) -> Iterator[_Tried]:
        """Give guesses about the position of a joint."""
        name, turns = self.regressor.joints[j], bool(self.description.turning[j])
        turned = self._of(now.moved.scaled(j, -1.0), now.guess, f"the position of {name} seems to have the other sign")
        yield turned
        yield _with(turned, now.guess.scaled(j, -1.0), f"the axis of {name} seems to point the other way")
        unit, factor = ("degrees", DEGREES) if turns else ("mm", MILLIMETRES)
        yield self._of(now.moved.scaled(j, factor), now.guess, f"the position of {name} seems to be in {unit}")
        if turns and abs(angle := self._zero(now, j)) > OFF:
            text = f"the zero of {name} seems to be off by {-math.degrees(angle):.0f} degrees"
            yield self._of(now.moved.shifted(j, angle), now.guess, text)

    def _exchanged(self, now: _Tried, i: int, j: int) -> Iterator[_Tried]:
        """Give guesses about two joints."""
        pair = f"{self.regressor.joints[i]} and {self.regressor.joints[j]} seem to be exchanged"
        yield _with(now, now.guess.exchanged(i, j), f"the torques of {pair}")
        moved = self._of(now.moved.exchanged(i, j), now.guess, f"the positions of {pair}")
        yield moved
        yield _with(moved, now.guess.exchanged(i, j), f"{pair}, with positions and torques")

    def _zero(self, now: _Tried, j: int) -> float:
        """Return what is to be added to the position of a joint so that it leaves least, within half a turn."""
        thinned = now.moved.thinned(THINNED)

        def left(angle: float) -> float:
            return self._of(thinned.shifted(j, angle), now.guess, "").found.left

        step = 2.0 * math.pi / TURNS
        angles = step * (np.arange(TURNS) - TURNS // 2 + 1)
        near = float(angles[np.argmin([left(angle) for angle in angles.tolist()])])
        if abs(near) < 0.5 * step:
            near = min((-0.5 * step, 0.0, 0.5 * step), key=left)
        if not near:
            return 0.0
        around = (near - 0.5 * step, near + 0.5 * step)
        found = minimize_scalar(left, bounds=around, method="bounded", options={"xatol": 0.01}).x
        return math.remainder(float(found), 2.0 * math.pi)


def _with(tried: _Tried, guess: Guess, text: str) -> _Tried:
    """Return the same motion with another guess about the torques."""
    return replace(tried, found=tried.sums.explained(guess), guess=guess, text=text)


def _than(log: float) -> str:
    """Return what a torque is that is right once it is multiplied by a factor with this logarithm."""
    return "large" if log < 0.0 else "small"


def _size(sums: TorqueSums, guess: Guess, joint: int) -> float:
    """Return the logarithm of the factor on the torque of a joint that leaves least, from 1 on."""

    def left(log: float) -> float:
        return sums.explained(guess.scaled(joint, math.exp(log)), joint).left

    at = {log: left(log) for log in (-STEP, 0.0, STEP)}
    best = min(at, key=at.__getitem__)
    if best:
        step, last = math.copysign(STEP, best), best
        while abs(last) < MOST and abs(last - best) < PATIENCE * STEP:
            last += step
            at[last] = left(last)
            best = min(at, key=at.__getitem__)
    around = (best - STEP, best + STEP)
    return float(minimize_scalar(left, bounds=around, method="bounded", options={"xatol": 0.02}).x)
