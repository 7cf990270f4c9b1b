"""An equation at the samples that are compared, and its solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.equations import Equation
from joint_id_core.estimators.regression.halves import with_halves
from joint_id_core.estimators.regression.instruments import Tools
from joint_id_core.estimators.regression.lacking import with_lacking
from joint_id_core.estimators.regression.least_squares import (
    ACCURACY,
    Solution,
    explained,
    solve,
    without,
)
from joint_id_core.estimators.regression.missing import (
    HELPS,
    share_explained,
    share_predicted,
)
from joint_id_core.estimators.regression.presliding import with_inertia
from joint_id_core.estimators.regression.share import Share, share_beside
from joint_id_core.estimators.regression.signals import Rows
from joint_id_core.estimators.regression.sliding import Sliding

RATHER = 0.5  # what one cause leaves of y over what another one leaves, below which it is the one


@dataclass(frozen=True)
class Samples:
    """An equation at the samples that are compared.

    Attributes:
        rows: the samples.
        fast: True for those at which the joint does not nearly rest, shape (R,).
        y, columns: in the band, shapes (R,) and (R, k).
        lacked: columns (R, m) of torques that the model lacks, by the option that adds them.
        time: instants of all samples of the recording in s, shape (T,).
        drive: part of y that the drive makes, at all samples, in the band, shape (T,).
        period: of the recording in s.
        tools: instruments; None if least squares will do.
        accuracy: see `least_squares.solve`.
        turning: see `presliding.turning`, shape (R, m).
        change: by how much the drive's part of y changes in a sample, shape (R,).
        loaded: whether the load of the arm was computed from a description.
        away: the equation without the instants at which the joint sticks; None if it has no friction, or instruments.
    """

    equation: Equation
    rows: Rows
    fast: NDArray[np.bool_]
    y: Array
    columns: Array
    lacked: Mapping[str, Array]
    time: Array
    drive: Array
    period: float
    tools: Tools | None = None
    accuracy: float = ACCURACY
    turning: Array = field(default_factory=lambda: np.zeros((0, 0)))
    change: Array = field(default_factory=lambda: np.zeros(0))
    loaded: bool = False
    away: Sliding | None = None

    def solve(self, positive: Sequence[bool], lag_s: float) -> Solution:
        """Return the solution; `lag_s` as in the options.

        If friction that turns over some distance predicts new samples better, inertia is that of a fit with it, since
        without it the inertia would be too small. The other parameters are those that describe the motion without it.
        Half of what it changes of the inertia is in doubt, and what it changes of the others if it matters. Without
        instruments, the covariance contains how far both halves of the recording are apart.

        Friction that is a straight line is that of the sliding joint; see `sliding`. Intervals contain what torques
        change that the model lacks; see `lacking`.
        """
        ask = partial(solve, positive=positive, lag=lag_s / self.step, accuracy=self.accuracy)
        beside, pieces, away = self._asked(positive, lag_s), self.rows.pieces, self.away

        def contained(y: Array, columns: Array, lacked: Mapping[str, Array]) -> Solution:
            found = ask(y, columns, pieces=pieces)
            found = with_halves(found, len(y), lambda part: ask(y[part], columns[part], pieces=pieces[part]))
            return with_lacking(found, self.equation, y, columns, lacked, beside)

        if away is not None and away.straight(beside):
            found = contained(away.y[:, 0], away.columns, away.lacked)
            return replace(found, r_squared=explained(self.y, self.columns @ found.values))
        if self.tools is not None:
            found = ask(self.y, self.columns, pieces=pieces, tools=self.tools)
        else:
            found = contained(self.y, self.columns, self.lacked)
        inertia, turn = np.array([n == self.equation.inertia for n in self.equation.names]), self.turn
        if turn is None or not inertia.any():
            return found
        y, columns = without(self.y[:, None], turn)[:, 0], without(self.columns, turn)
        other = contained(y, columns, {option: without(more, turn) for option, more in self.lacked.items()})
        return with_inertia(found, other, inertia, np.array(positive))

    def share(self, positive: Sequence[bool], lag_s: float) -> Share | None:
        """Return by how much of a sample the drive comes late; None without a drive or with instruments."""
        if self.tools is not None or not self.change.any():
            return None
        y, columns, change = self.y, self.columns, self.change
        if self.turns_rather_than(_explained(y, columns, change)):
            columns = self.with_turn
        elif self.away is not None:  # what friction does while the joint sticks hides a delay
            y, columns, change = self.away.y[:, 0], self.away.columns, self.away.change[:, 0]
        return share_beside(y, columns, change, self._asked(positive, lag_s), len(positive))

    def turns_rather_than(self, share: float) -> bool:
        """Return whether friction that turns after reversals explains y rather than a delay, which explains a `share`.

        Either explains a part of what the other does.
        """
        return self.turn is not None and 1.0 - _explained(self.y, self.columns, self.turn) < RATHER * (1.0 - share)

    @property
    def with_turn(self) -> Array:
        """Columns of the parameters, and last of friction that turns after reversals, shape (R, k + 1)."""
        assert self.turn is not None
        return np.column_stack([self.columns, self.turn])

    def _asked(self, positive: Sequence[bool], lag_s: float = 0.0) -> Callable[[Array, Array], Solution]:
        """Return what solves the equation with more columns."""
        known = partial(solve, pieces=self.rows.pieces, lag=lag_s / self.step, accuracy=self.accuracy)
        return lambda y, columns: known(y, columns, [*positive, *[False] * (columns.shape[1] - len(positive))])

    @cached_property
    def turn(self) -> Array | None:
        """What friction lacks after reversals, shape (R,); None if that would predict new samples no better."""
        left = [share_explained(self.y, self.columns, column[:, None]) for column in self.turning.T]
        if not left:
            return None
        best = self.turning[:, int(np.argmax(left))]
        return best if share_predicted(self.y, self.columns, best[:, None]) > HELPS else None

    @property
    def step(self) -> float:
        """Typical distance of two of the samples that are compared, in s."""
        return float(np.median(np.diff(self.time[self.rows.index]))) if len(self.rows.index) > 1 else self.period


def _explained(y: Array, columns: Array, more: Array) -> float:
    """Return the share of y (T,) that columns (T, k) and one more explain, whatever their signs."""
    table = np.column_stack([columns, more])
    return explained(y, table @ np.linalg.lstsq(table, y, rcond=None)[0])
