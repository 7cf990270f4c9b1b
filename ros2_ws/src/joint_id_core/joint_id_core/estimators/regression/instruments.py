"""Instruments for equations that hold the twist of a gear, the small difference of two encoders.

Errors of the encoders make the twist noisy, and least squares then finds too small a stiffness. Instruments are signals
that go with the twist but not with these errors (two-stage least squares; for robots Janot, Vandanjon and Gautier, IEEE
TCST 22, 2014): what a rigid joint with gravity would feel along the motion. This is the commanded motion where it was
recorded, else that of the motor, whose errors are small against its way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import side_of
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.estimators.regression.path import Path

LEAST_SHOWN = 0.1  # share of what is new in a column that the instruments must show
# The same for a column that is not linear in the twist: left out, the linear one would stand for both, and seem known.
LEAST_BENT = 1e-3
EXOGENOUS = 0.9  # the same from which a column is as good as known
SAME = 1e-6  # relative difference of two columns that rounding makes


@dataclass(frozen=True)
class Tools:
    """Instruments of an equation.

    Attributes:
        table: signals, shape (T, m).
        bent: which columns of the equation are not linear in the twist, shape (k,).
    """

    table: Array
    bent: NDArray[np.bool_]

    def part(self, rows: slice | NDArray[np.bool_]) -> Tools:
        """Return the instruments of some of the samples."""
        return replace(self, table=self.table[rows])


def twisted(moved: Motion, ratio: float, factor: float, rate_factor: float) -> Motion:
    """Return a motion of motor and link with `factor` times the twist and `rate_factor` times its rate."""
    motor = {**moved.x, "motor_acceleration": moved.rates["motor_velocity"]}

    def link(name: str, own: Array) -> Array:
        if side_of(name) != "link":
            return own
        rigid = motor[name.replace("link", "motor")] / ratio
        return np.asarray(rigid - (factor if name.endswith("_position") else rate_factor) * (rigid - own))

    return Motion(moved.x, {n: link(n, v) for n, v in moved.u.items()}, moved.rates)


def beyond(columns: Callable[[Motion], Array], moved: Motion, ratio: float) -> NDArray[np.bool_]:
    """Return which columns (k,) of an equation go with the rate of the twist, whose noise is larger than the signal."""
    with_rate, without = (columns(twisted(moved, ratio, 1.0, factor)) for factor in (1.0, 0.0))
    return np.asarray(np.nanmax(np.abs(without - with_rate), axis=0) > SAME * np.nanmax(np.abs(with_rate), axis=0))


def bent(columns: Callable[[Motion], Array], moved: Motion, ratio: float) -> NDArray[np.bool_]:
    """Return which columns (k,) of an equation are not linear in the twist."""
    none, once, twice = (columns(twisted(moved, ratio, factor, factor)) for factor in (0.0, 1.0, 2.0))
    return np.asarray(np.nanmax(np.abs(twice - 2.0 * once + none), axis=0) > SAME * np.nanmax(np.abs(twice), axis=0))


def rigid(columns: Callable[[Motion], Array], moved: Motion, path: Path, ratio: float = 1.0) -> Array:
    """Return the columns of a rigid joint with gravity, shape (T, m); all that are zero are left out."""
    load = np.column_stack([np.ones_like(path.angle), np.cos(path.angle), np.sin(path.angle)])
    found = np.column_stack([columns(path.motion(moved, ratio)), load])
    return np.asarray(found[:, np.nanmax(np.abs(found), axis=0) > 0.0])


def instruments(columns: Callable[[Motion], Array], moved: Motion, path: Path, ratio: float) -> Array:
    """Return the instruments of a joint with a twist, shape (T, m): what `rigid` returns, and more.

    For columns that are not linear in the twist, those with the twist that the others show are added (Kelejian, Journal
    of the American Statistical Association 66, 1971).
    """
    found = rigid(columns, moved, path, ratio)
    more = bent(columns, moved, ratio)
    if more.any():
        known = np.isfinite(found).all(axis=1) & np.isfinite(moved.u["link_position"])
        motor = moved.x["motor_position"] / ratio
        twist = np.full_like(motor, np.nan)
        twist[known] = projected((motor - moved.u["link_position"])[known, None], found[known])[:, 0]
        fitted = Motion(moved.x, {**moved.u, "link_position": motor - twist}, moved.rates)
        found = np.column_stack([found, columns(fitted)[:, more]])
    return found


def shown(columns: Array, tools: Array, bent: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which columns (T, k) the instruments (T, m) show, beside those that they show better, shape (k,).

    Columns that are `bent` (k,) come last, and only if all others are shown.
    """
    size = np.sqrt(np.mean(columns**2, axis=0))
    scaled = columns / np.where(size > 0.0, size, 1.0)
    seen = projected(scaled, tools)
    found, taken = np.zeros(columns.shape[1], dtype=bool), np.zeros((len(columns), 0))

    def share(k: int) -> float:
        new = scaled[:, k] - taken @ (taken.T @ scaled[:, k])
        part = seen[:, k] - taken @ (taken.T @ seen[:, k])
        energy = float(new @ new)
        return float(part @ part) / energy if energy > SAME**2 * len(new) else 0.0

    while not found.all():
        open_ = ~found if found[~bent].all() else ~found & ~bent
        shares = {int(k): share(int(k)) for k in np.flatnonzero(open_)}
        best = next((k for k, part in shares.items() if part > EXOGENOUS), max(shares, key=shares.__getitem__))
        if shares[best] < (LEAST_BENT if bent[best] else LEAST_SHOWN):
            break
        part = seen[:, best] - taken @ (taken.T @ seen[:, best])
        taken, found[best] = np.column_stack([taken, part / np.linalg.norm(part)]), True
    return found


def projected(columns: Array, tools: Array) -> Array:
    """Return what the instruments (T, m) show of columns (T, k): the first stage of two-stage least squares."""
    basis = np.linalg.svd(tools / np.sqrt(np.mean(tools**2, axis=0)), full_matrices=False)
    kept = basis[0][:, basis[1] > SAME * basis[1][0]]
    return np.asarray(kept @ (kept.T @ columns))
