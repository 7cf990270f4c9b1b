"""What least squares leaves unexplained: loads that the equations lack, and its memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.equations import Motion

SLOW = 0.1  # of the rms velocity, below which a joint may stick


def share_explained(y: Array, columns: Array, more: Array) -> float:
    """Return the share of what least squares of y (T,) on columns (T, k) leaves that `more` columns (T, m) explain."""
    table = np.column_stack([columns, more])
    scale = np.sqrt(np.mean(table**2, axis=0))
    table = table / np.where(scale > 0.0, scale, 1.0)
    before, after = (
        y - part @ np.linalg.lstsq(part, y, rcond=None)[0] for part in (table[:, : columns.shape[1]], table)
    )
    left = float(before @ before)
    return 1.0 - float(after @ after) / left if left > 0.0 else 0.0


def at_speed(motion: Motion, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return True for those of the rows (R,) in which every velocity is well above zero; for all if there is none."""
    fast = np.ones(len(rows), dtype=bool)
    for name, values in motion.x.items():
        if name.endswith("_velocity"):
            speed = np.abs(values[rows])
            fast &= speed > SLOW * np.sqrt(np.mean(speed**2))
    return fast


def gravity(angle: Array) -> Array:
    """Return the columns of a load that depends on the angle (T,) of the link."""
    return np.column_stack([np.cos(angle), np.sin(angle)])


def autocorrelation(residuals: Array, lag: int) -> float:
    """Return the autocorrelation of residuals (T,) at a lag in samples; 0 if there are too few."""
    energy = float(residuals @ residuals)
    if lag >= len(residuals) or energy == 0.0:
        return 0.0
    return float(residuals[lag:] @ residuals[:-lag]) / energy
