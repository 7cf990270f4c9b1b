"""Linear least squares of one equation, with the bounds of positive parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.covariance import automatic_lag, jackknife, newey_west
from joint_id_core.estimators.regression.instruments import Tools, projected, shown

# What is certain at best, as a part of y: between two samples the equations are not exact where friction reverses.
ACCURACY = 1e-3
# The same with a current that is a state: it changes within a sample, so the samples are not its mean.
ACCURACY_OF_CURRENT = 5e-3
CHANCE = 4.0  # times its variance: two standard deviations, up to which an error of a prediction is chance
FIRST = 0.7  # share of the samples that is fitted to predict the others
UNKNOWN = 1e-12  # smallest singular value of columns of unit length that rounding does not make


@dataclass(frozen=True)
class Solution:
    """Values (k,) and covariance (k, k) of the parameters of an equation.

    Attributes:
        held: True for positive parameters that least squares makes negative, shape (k,); their values are zero.
        unbounded, sigma: values and standard deviations without these bounds, shape (k,).
        doubt: what the model lacks may change of them, shape (k,): in the covariance, not in `sigma`.
        reasons: of the doubt, as clauses.
        changes: half of what they change between the halves of the recording, shape (k,): as `doubt`.
        halves: their values in both halves, shape (2, k), NaN where these are the same.
        unseen: True for parameters whose column is zero or follows from the others, shape (k,).
        r_squared: share of the mean square of y about its mean that is explained.
        lag: memory of the residuals in samples.
    """

    values: Array
    covariance: Array
    held: NDArray[np.bool_]
    unseen: NDArray[np.bool_]
    unbounded: Array
    sigma: Array
    r_squared: float
    lag: float
    doubt: Array | float = 0.0
    reasons: tuple[str, ...] = ()
    changes: Array | float = 0.0
    halves: Array | float = float("nan")

    @property
    def wide(self) -> Array:
        """Standard deviations without the bounds of positive parameters, with doubt and changes, shape (k,)."""
        return np.hypot(np.hypot(self.sigma, self.doubt), self.changes)

    @property
    def below(self) -> NDArray[np.bool_]:
        """True for positive parameters that the data pull below zero by more than their intervals, shape (k,)."""
        return np.asarray(self.held & (self.unbounded < -1.96 * self.wide))


def solve(
    y: Array, columns: Array, positive: Sequence[bool], pieces: NDArray[np.int64], lag: float = 0.0,
    tools: Tools | None = None, accuracy: float = ACCURACY,
) -> Solution:  # fmt: skip
    """Fit y (T,) with columns (T, k); `positive` parameters do not get below zero.

    A positive parameter that least squares makes negative is held at zero, the most negative one first, and the
    others are fitted again. `lag` in samples is that of the covariance; 0 finds it. No value is known better than to
    the part `accuracy` of y.

    With instruments these are two-stage least squares, the covariance is that of a jackknife without such bounds, and
    columns that the instruments do not show are unseen.
    """
    count = columns.shape[1]
    held, unseen = np.zeros(count, dtype=bool), _unseen(columns)
    if tools is not None:
        unseen[~unseen] = ~shown(columns[:, ~unseen], tools.table, tools.bent[~unseen])
    unbounded = sigma = np.full(count, np.nan)
    covariance = np.full((count, count), np.nan)
    while True:
        free = np.flatnonzero(~held & ~unseen)
        values = np.zeros(count)
        values[free] = _fitted(y, columns[:, free], None if tools is None else tools.table)
        residuals = y - columns @ values
        memory = lag or automatic_lag(columns[:, free] * residuals[:, None])
        size = np.sqrt(np.mean(columns[:, free] ** 2, axis=0) / np.mean(y**2))
        if tools is None:
            covariance = np.full((count, count), np.nan)
            covariance[np.ix_(free, free)] = newey_west(columns[:, free], residuals, pieces, memory)
            covariance[free, free] += (accuracy / size) ** 2
        elif not held.any():
            covariance[np.ix_(free, free)] = jackknife(
                partial(_refitted, y, columns[:, free], tools.table), len(y), memory
            )
            covariance[free, free] += (accuracy / size) ** 2
        if not held.any():
            unbounded, sigma = values, np.sqrt(np.diag(covariance))
        below = np.where(np.array(positive) & ~held & ~unseen, values / np.sqrt(np.diag(covariance)), np.inf)
        if not len(free) or below.min() >= 0.0:
            break
        held[int(np.argmin(below))] = True
    return Solution(
        values, covariance, held, unseen, unbounded, sigma, explained(y, columns @ values), memory
    )  # fmt: skip


def explained(y: Array, predicted: Array) -> float:
    """Return the share of the mean square of y (T,) about its mean that is predicted; NaN if y is constant."""
    spread = float(np.mean((y - y.mean()) ** 2))
    return 1.0 - float(np.mean((y - predicted) ** 2)) / spread if spread > 0.0 else float("nan")


def without(table: Array, column: Array) -> Array:
    """Return a table (T, m) without what a column (T,) explains of it.

    A fit of what is left gives the values and the covariance of one with this column (Frisch & Waugh, Econometrica 1,
    1933; Lovell, J. Am. Stat. Assoc. 58, 1963).
    """
    energy = float(column @ column)
    return np.asarray(table - np.outer(column, column @ table / energy)) if energy > 0.0 else table


def two_stage(y: Array, columns: Array, tools: Array) -> Array:
    """Return the values (k,) of two-stage least squares of y (T,) on columns (T, k) with instruments (T, m)."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    return np.asarray(np.linalg.lstsq(projected(columns / scale, tools), y, rcond=None)[0] / scale)


def _fitted(y: Array, columns: Array, tools: Array | None) -> Array:
    if tools is None:
        return np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0])
    return two_stage(y, columns, tools)


def _refitted(y: Array, columns: Array, tools: Array, kept: NDArray[np.bool_]) -> Array:
    return two_stage(y[kept], columns[kept], tools[kept])


class HeldOut(NamedTuple):
    """What a fit of the first samples explains of the last ones.

    Attributes:
        share: of what a fit of rests leaves of them; NaN if the first samples do not show all parameters.
        at_best: the same without errors that may be chance, as the first samples tell the parameters only so far.
    """

    share: float
    at_best: float


def explained_later(
    y: Array, columns: Array, positive: Sequence[bool], static: NDArray[np.bool_], pieces: NDArray[np.int64],
    tools: Tools | None = None,
) -> HeldOut:  # fmt: skip
    """Return what a fit of the first samples explains of the last ones: a share of what a fit of rests leaves of them.

    That is one with the `static` columns alone, or with a constant if there are none: else the load of gravity, which
    is large, would hide that friction and inertia are wrong.
    """
    first, unknown = round(FIRST * len(y)), HeldOut(float("nan"), float("nan"))
    if not 0 < first < len(y):
        return unknown
    tools = None if tools is None else tools.part(slice(0, first))
    fitted = solve(y[:first], columns[:first], positive, pieces[:first], 1.0, tools)
    if tools is None and (fitted.unseen & ~_unseen(columns)).any():
        return unknown
    rest = columns[:, static] if static.any() else np.ones((len(y), 1))
    known = rest @ np.linalg.lstsq(rest[:first], y[:first], rcond=None)[0]
    all_, left = y - known, y - columns @ fitted.values
    spread = float(np.mean(all_[first:] ** 2))
    if not spread > 0.0:
        return unknown
    missed, covariance = float(np.mean(left[first:] ** 2)), np.nan_to_num(fitted.covariance)
    by_chance = float(np.einsum("tk,kl,tl->", columns[first:], covariance, columns[first:])) / (len(y) - first)
    return HeldOut(1.0 - missed / spread, 1.0 - max(0.0, missed - CHANCE * by_chance) / spread)


def _unseen(columns: Array) -> NDArray[np.bool_]:
    """Return which columns are zero, or a combination of those before them."""
    unseen = np.zeros(columns.shape[1], dtype=bool)
    basis = np.zeros((len(columns), 0))
    for k, column in enumerate(columns.T):
        length = float(np.linalg.norm(column))
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)
        if length == 0.0 or np.linalg.norm(rest) < np.sqrt(UNKNOWN) * length:
            unseen[k] = True
        else:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    return unseen
