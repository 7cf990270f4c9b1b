"""What the torques of an arm may hold that its model lacks: named where they show it, and counted in the intervals.

A score (Lagrange multiplier) test (Breusch & Pagan, Review of Economic Studies 47, 1980), as of one joint in
`estimators.innovations.misfit`: would a small fault of a given kind explain what the fit leaves? Such a fault moves the
values; the square of that is added to their covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.arm.autoregressive import autoregressive
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import Equations
from joint_id_core.arm.stacked import Stacked, centred, solved
from joint_id_core.arm.tested_faults import Suspect, tested_faults
from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.covariance import newey_west

LIKELY, SURE = 3.0, 5.0  # standard deviations of a fault from which it counts, and is told
OWN_SHARE = 1e-4  # least share of the square of its torque that the parameters do not explain as well
MOST = 3  # faults that are used together
DUST = 1e-9  # size of the torque of a fault over that of the largest one which is rounding


@dataclass(frozen=True)
class Suspects:
    """Faults that were found.

    Attributes:
        texts: those that are sure, in words.
        amounts: of all, by name.
        shift: what all may do to the values, (P,).
        torque: mean torque in Nm that they add to each joint, (n,).
        gross: one of the texts if it is of a fault too large to be what it is called; else empty.
        usual: covariance of what the others do to the values in any robot, as far as nothing shows it, (P, P).
    """

    texts: tuple[str, ...]
    amounts: dict[str, float]
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
    some = list(tested_faults(description, parts, whole))
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
    named = {some[k].name: float(a) for k, a in amount.items()}
    return Suspects(tuple(told.values()), named, shift, mean, gross, moved @ moved.T)


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
