"""What the torques of an arm may hold that its model lacks: named where they show it, and counted in the intervals.

A score (Lagrange multiplier) test (Breusch & Pagan, Review of Economic Studies 47, 1980), as of one joint in
`estimators.innovations.misfit`: would a small fault of a given kind explain what the fit leaves? Such a fault moves the
values; the square of that is added to their covariance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.autoregressive import autoregressive
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import PAYLOAD, Equations
from joint_id_core.arm.gravity_direction import pull_of
from joint_id_core.arm.stacked import Stacked, centred, solved
from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.covariance import newey_west

LIKELY, SURE = 3.0, 5.0  # standard deviations of a fault from which it counts, and is told
OWN_SHARE = 1e-4  # least share of the square of its torque that the parameters do not explain as well
MOST = 3  # faults that are used together
ACROSS = 0.1  # share of gravity that an axis is across at least
GROSS = math.radians(30.0)  # an angle that no mounting is off by
ZERO = 2e-3  # rad, standard deviation of the zeros of joints of any robot
TOLD_ZERO = math.radians(1.0)  # most standard deviation of a zero with which it is told from what else a law lacks
DUST = 1e-9  # size of the torque of a fault over that of the largest one which is rounding


@dataclass(frozen=True)
class Suspect:
    """A fault.

    Attributes:
        text: what it is, by its amount; empty for an amount that no fault of the kind has.
        torque: of all joints by unit fault, of each recording, (R, n).
        most: amount beyond which it stands for something else.
        usual: standard deviation of the amount that robots have anyway.
        clear: most standard deviation of the amount with which it is asked for, unless it is beyond `most`.
    """

    text: Callable[[float], str]
    torque: Sequence[Array]
    most: float = math.inf
    usual: float = 0.0
    clear: float = math.inf


@dataclass(frozen=True)
class Suspects:
    """Faults that were found.

    Attributes:
        texts: those that are sure, in words.
        shift: what all may do to the values, (P,).
        torque: mean torque in Nm that they add to each joint, (n,).
        gross: one of the texts if it is of a fault too large to be what it is called; else empty.
        usual: covariance of what the others do to the values in any robot, as far as nothing shows it, (P, P).
    """

    texts: tuple[str, ...]
    shift: Array
    torque: Array
    gross: str
    usual: Array

    @property
    def excess(self) -> Array:
        """Covariance of what those that were found may do, (P, P)."""
        return np.outer(self.shift, self.shift)


def suspects(
    description: Description, parts: Sequence[Equations], table: Stacked, values: Array, whole: Array, lag: float
) -> Suspects:
    """Test what a fit leaves.

    Args:
        description: of the arm.
        parts: equations of all recordings; `table`: of them.
        values: of the parameters of the table, (P,); `whole`: of all, those of a payload included.
        lag: in equations, over which what is left remembers.
    """
    left = table.y - table.columns @ values
    weights = 1.0 / table.scatter(left)[table.joint]
    columns = table.columns * weights[:, None]
    some = list(_candidates(description, parts, whole))
    faults = np.array([_stacked(parts, fault.torque) for fault in some]).T * weights[:, None]
    squares = np.sum(faults**2, axis=0)
    faults[:, squares < DUST**2 * squares.max()] = 0.0
    shifts = solved(columns, faults, table.precision)
    test = _Test(some, faults - columns @ shifts, left * weights, np.sum(faults**2, axis=0), table, lag)
    taken = test.selected()
    amounts, sizes = test.amounts(taken)
    shift = shifts[:, taken] @ amounts
    others = [k for k, fault in enumerate(some) if fault.usual and k not in taken]
    moved = shifts[:, others] * [test.spread(taken, k) for k in others]
    told = {
        k: f"{text} ({abs(size):.2g} sigma)"
        for _, k, amount, size in sorted(zip(-np.abs(sizes), taken, amounts, sizes, strict=True))
        if abs(size) > SURE and (text := some[k].text(float(amount)))
    }
    amount = dict(zip(taken, amounts, strict=True))
    gross = next((text for k, text in told.items() if abs(amount[k]) > some[k].most), "")
    mean = sum((a * _mean(parts, some[k].torque) for k, a in amount.items()), np.zeros(table.count))
    return Suspects(tuple(told.values()), shift, mean, gross, moved @ moved.T)


@dataclass(frozen=True)
class _Test:
    """Torques of faults without what parameters explain of them, (T, D), and what is left, (T,), both weighed."""

    faults: Sequence[Suspect]
    own: Array
    left: Array
    whole: Array
    table: Stacked
    lag: float

    def selected(self) -> list[int]:
        """Return the faults that are taken, the most significant one first."""
        taken: list[int] = []
        while len(taken) < MOST:
            sizes = [self._size(taken, k) for k in range(len(self.faults))]
            best = int(np.argmax(sizes))
            if not sizes[best] > LIKELY:
                break
            taken.append(best)
        return taken

    def amounts(self, taken: list[int]) -> tuple[Array, Array]:
        """Return the amounts of some faults together, and their sizes in standard deviations."""
        own = self.own[:, taken]
        found = solved(own, self.left)
        rest = self.left - own @ found
        pieces, joint = self.table.pieces, self.table.joint
        variances = [newey_west(own, rest, pieces, self.lag), autoregressive(own, rest, joint, pieces, self.lag)]
        sigma = np.sqrt(np.max([np.diag(v) for v in variances], axis=0))
        return found, found / np.where(sigma > 0.0, sigma, np.inf)

    def spread(self, taken: list[int], k: int) -> float:
        """Return the standard deviation of the amount of a fault that has a usual one, by what is left, too."""
        usual = self.faults[k].usual
        if not self._apart(taken, k):
            return usual
        found, sizes = self.amounts([*taken, k])
        return float(usual / np.hypot(1.0, usual * sizes[-1] / found[-1]))

    def _size(self, taken: list[int], k: int) -> float:
        """Return the size of a fault in standard deviations; 0 if it is taken, or not told from other things."""
        if k in taken or not self._apart(taken, k):
            return 0.0
        found, sizes = self.amounts([*taken, k])
        amount, size = abs(float(found[-1])), abs(float(sizes[-1]))
        return size if amount <= size * self.faults[k].clear or amount > self.faults[k].most else 0.0

    def _apart(self, taken: list[int], k: int) -> bool:
        """Return whether a fault is told from the parameters and those that are taken."""
        own = self.own[:, k]
        if taken:
            own = own - self.own[:, taken] @ solved(self.own[:, taken], own)
        return bool(own @ own > OWN_SHARE * self.whole[k] > 0.0)


def _candidates(description: Description, parts: Sequence[Equations], whole: Array) -> Iterator[Suspect]:
    """Yield the faults that are tested; `whole` are the values of all parameters, those of a payload included."""
    joints = list(zip(description.joints, description.turning.tolist(), strict=True))
    down, first, own = description.gravity, parts[0].base, np.eye(len(joints))
    yield Suspect(lambda s: f"the torques seem to be {1e3 * s:.2g} ms late", [-part.rate for part in parts])
    if down.any():
        mass, moments = float(whole[first]), whole[first + 1 : first + 4]
        payload = (mass, moments / mass) if any(part.loaded for part in parts) and mass > 0.0 else None
        carrying = Description(description.text, description.source, down.tolist(), payload)
        empty, carried = pull_of(description), pull_of(description, payload)
        at = [(carried if part.loaded else empty)(part.q) for part in parts]
        for axis, name in zip(np.eye(3), "xyz", strict=True):
            if np.linalg.norm(across := np.cross(axis, down)) > ACROSS * np.linalg.norm(down):
                yield Suspect(partial(_turned, name), [some @ across for some in at], GROSS)
        arms = [carrying if part.loaded else description for part in parts]
        slopes = [arm.by_position(part.q, part.dq, part.ddq) for arm, part in zip(arms, parts, strict=True)]
        for j, (name, turns) in enumerate(joints):
            moved = [slope[:, :, j] for slope in slopes]
            yield Suspect(partial(_off_zero, name, turns), moved, *((GROSS, ZERO, TOLD_ZERO) if turns else ()))
    for j, (name, turns) in enumerate(joints):
        yield Suspect(partial(_pulled, name, turns), [part.q * own[j] for part in parts])
    for loaded in (False, True):
        for k in [k for k, part in enumerate(parts) if part.loaded == loaded][1:]:
            more = [part.columns[:, :, first] * (i == k) for i, part in enumerate(parts)]
            yield Suspect(partial(_carries, k + 1, "payload" if loaded else "last link"), more)
    for k, part in enumerate(parts):
        later = np.where(part.time > part.time.mean(), 1.0, 0.0)
        more = [p.columns[:, :, first] * later[:, None] if i == k else 0.0 * p.y for i, p in enumerate(parts)]
        yield Suspect(partial(_changes, f"in recording {k + 1}" if len(parts) > 1 else "meanwhile"), more)


def _turned(axis: str, amount: float) -> str:
    return f"gravity seems to be turned by {math.degrees(amount):.2g} degrees about {axis} of the base (base_gravity)"


def _off_zero(joint: str, turns: bool, amount: float) -> str:
    if not turns:
        return f"the zero of {joint} seems to be off by {-1e3 * amount:.2g} mm"
    other = "" if abs(amount) < GROSS else ", or its axis to point the other way, or joints to be exchanged"
    return f"the zero of {joint} seems to be off by {-math.degrees(amount):.2g} degrees{other}"


def _pulled(joint: str, turns: bool, amount: float) -> str:
    if amount < 0.0:
        return ""  # no spring pushes away from where it rests
    return f"something pulls at {joint} as a spring of {amount:.2g} {'Nm/rad' if turns else 'N/m'}"


def _carries(recording: int, what: str, amount: float) -> str:
    more = "more" if amount > 0.0 else "less"
    return f"the {what} seems to have about {abs(amount):.2g} kg {more} in recording {recording} than in the others"


def _changes(when: str, amount: float) -> str:
    return f"the load of the last link seems to change {when}, by about {amount:.2g} kg"


def _of_payload(part: Equations) -> NDArray[np.bool_]:
    """Return which parameters are those of a payload, (P,)."""
    place = np.arange(part.columns.shape[2])
    return (place >= part.base) & (place < part.base + PAYLOAD)


def _mean(parts: Sequence[Equations], torque: Sequence[Array]) -> Array:
    """Return the mean of torques of all joints, (R, n) of each recording, over the equations that count, (n,)."""
    sums = [np.where(p.used, np.nan_to_num(some), 0.0).sum(axis=0) for p, some in zip(parts, torque, strict=True)]
    counts = [np.count_nonzero(part.used, axis=0) for part in parts]
    return np.asarray(np.sum(sums, axis=0) / np.maximum(np.sum(counts, axis=0), 1))


def _stacked(parts: Sequence[Equations], torque: Sequence[Array]) -> Array:
    """Return torques of all joints, (R, n) of each recording, in the order of a table of their equations, (T,)."""
    rows = [
        centred(np.nan_to_num(some[part.used[:, j], j]))
        for part, some in zip(parts, torque, strict=True)
        for j in range(part.used.shape[1])
    ]
    return np.concatenate(rows)
