"""Whether all torques of a recording change by one factor at some instant: the gain of the drive did, or the load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.recording import Array

if TYPE_CHECKING:  # SciPy loads with it
    from joint_id_core.estimators.regression.samples import Samples

INSTANTS = 97  # that are tried
ENDS = 0.1  # share of the recording at either end in which none is
# Share of what is left of the torque that the change explains. On recordings of a UR10e, a UR3e and EMPS, whose gains
# do not change, it is 0.22 at most, in quarters of them below 0.85; of a change of 10 % in a simulated joint 0.98.
EXPLAINS = 0.85
LEAST = 0.05  # of the factor from 1; friction changes by less while a gear gets warm
LEFT = 1e-3  # share of the torque that is left at least without the change: less is told by anything
ROUNDS = 4


@dataclass(frozen=True)
class Change:
    """All torques change by a `factor` at the instant `at` in s; `left` is the share of them that is left with it."""

    at: float
    factor: float
    left: float

    def text(self, begin: float, quantity: str) -> str:
        """Return it in words, for a recording that begins at an instant in s."""
        return (
            f"from {self.at - begin:.3g} s on the {quantity} is {self.factor:.3g} times what the same motion took "
            "before: the gain of the drive changed there, or what the joint moves; fit both parts by themselves "
            "(--end, --start)"
        )


def changed_gain(samples: Samples) -> str:
    """Return a clause that says when the torque of an equation changes, and by which factor; empty if it does not."""
    fast = samples.fast
    found = change_of(samples.time[samples.rows.index][fast], samples.y[fast], samples.columns[fast])
    return "" if found is None else found.text(samples.time[0], samples.equation.quantity)


def change_of(time: Array, y: Array, columns: Array) -> Change | None:
    """Return the change of y (R,), which columns (R, k) explain, at instants (R,) in s; None if there is none."""
    if len(y) < 4 * columns.shape[1]:
        return None
    basis, _ = np.linalg.qr(columns)
    predicted = basis @ (basis.T @ y)
    left = y - predicted
    if not left @ left > LEFT * (y @ y):
        return None
    instants = np.quantile(time, np.linspace(ENDS, 1.0 - ENDS, INSTANTS))
    at = float(max(instants, key=lambda t: _explained(basis, left, np.where(time > t, predicted, 0.0))))
    after, factor = time > at, 1.0
    torque = predicted  # before the change
    for _ in range(ROUNDS):  # Gauss-Newton: the equation is not linear in factor and parameters together
        scaled = basis * np.where(after, factor, 1.0)[:, None]
        values = np.linalg.lstsq(np.column_stack([scaled, np.where(after, torque, 0.0)]), y, rcond=None)[0]
        torque, factor = basis @ values[:-1], factor + float(values[-1])
    rest = y - torque * np.where(after, factor, 1.0)
    if 1.0 - float(rest @ rest) / float(left @ left) < EXPLAINS or abs(factor - 1.0) < LEAST:
        return None
    if factor <= 0.0:  # no gain: a drive that froze looks so
        return None
    return Change(at, factor, float(rest @ rest) / float(y @ y))


def _explained(basis: Array, left: Array, column: Array) -> float:
    """Return by how much a column (R,) beside those of an orthonormal basis (R, k) lessens the squares of `left`."""
    own = column - basis @ (basis.T @ column)
    size = float(own @ own)
    return float(own @ left) ** 2 / size if size > 0.0 else 0.0
