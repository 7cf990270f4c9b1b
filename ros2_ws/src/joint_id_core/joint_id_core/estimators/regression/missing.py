"""Torques that a model may lack: what they would explain of the samples, and of samples that were not fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import side_of
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.filtering.offline import FilterOptions, differentiate
from joint_id_core.models import Model

GRAVITY, STRIBECK, EYRING = "--gravity", "--friction stribeck", "--friction eyring"  # options that add a torque
COMPLIANCE = "a flexible gear"
SLOW = 0.1  # of the rms velocity, below which a joint may stick
STUCK = 0.02  # the same for friction that rises at low speed
HELPS = 0.05  # least share of the error of new samples that a torque takes away, for it to be believed
FOLDS = 4  # of the samples; each is predicted by a fit of the others


def missing_torques(motion: Motion, model: Model, time: Array, cutoff_hz: float) -> dict[str, Array]:
    """Return columns (T, m) of the torques that a model lacks, by the option that adds them.

    `motion` at the instants `time` in s had a low-pass with this cutoff. A gear between two inertias adds, to first
    order in its compliance, a torque that goes with the fourth derivative of the position (Spong 1987).
    """
    q, w = motion.x.get("link_position"), motion.x.get("link_velocity")
    found = {}
    if {side_of(n) for n in (*model.state_names, *model.input_names)} - {None} == {"link"}:
        options = FilterOptions(cutoff_hz=cutoff_hz)
        found[COMPLIANCE] = differentiate(time, motion.rates["link_velocity"], options, 2)[2][:, None]
    if q is not None and not model.has_gravity:
        found[GRAVITY] = np.column_stack([np.cos(q), np.sin(q)])
    if w is not None:
        low = SLOW * np.sqrt(np.nanmean(w**2)) or 1.0
        found[STRIBECK] = (np.sign(w) * np.exp(-((w / low) ** 2)))[:, None]
        found[EYRING] = (w * np.abs(w))[:, None]
    return found


def at_speed(motion: Motion, rows: NDArray[np.int64], least: float = SLOW) -> NDArray[np.bool_]:
    """Return True for those of the rows (R,) in which every velocity is above a share of its rms; all if there is none.

    A joint that sticks may bear any torque.
    """
    fast = np.ones(len(rows), dtype=bool)
    for name, values in motion.x.items():
        if name.endswith("_velocity"):
            speed = np.abs(values[rows])
            fast &= speed > least * np.sqrt(np.mean(speed**2))
    return fast


def share_explained(y: Array, columns: Array, more: Array) -> float:
    """Return the share of what least squares of y (T,) on columns (T, k) leaves that `more` columns (T, m) explain."""
    return _less(_left(y, columns), _left(y, np.column_stack([columns, more])))


def share_predicted(y: Array, columns: Array, more: Array) -> float:
    """Return the same for samples that were not fitted, in `FOLDS` parts; negative if `more` makes it worse."""
    part = np.arange(len(y)) * FOLDS // max(1, len(y))
    return _less(*(_predicted(y, table, part) for table in (columns, np.column_stack([columns, more]))))


def _less(before: Array, after: Array) -> float:
    energy = float(before @ before)
    return 1.0 - float(after @ after) / energy if energy > 0.0 else 0.0


def _left(y: Array, table: Array, fitted: NDArray[np.bool_] | slice = slice(None)) -> Array:
    """Return what least squares on the `fitted` samples leaves of all; the table (T, k) is scaled for it."""
    scale = np.sqrt(np.mean(table**2, axis=0))
    table = table / np.where(scale > 0.0, scale, 1.0)
    return np.asarray(y - table @ np.linalg.lstsq(table[fitted], y[fitted], rcond=None)[0])


def _predicted(y: Array, table: Array, part: NDArray[np.int64]) -> Array:
    return np.concatenate([_left(y, table, part != k)[part == k] for k in range(FOLDS)])
