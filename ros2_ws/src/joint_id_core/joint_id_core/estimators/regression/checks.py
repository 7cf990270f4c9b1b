"""Loads that the equations lack, sought in what they leave unexplained."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array

EXPLAINED = 0.5  # share of the unexplained mean square that a load explains, from which the model is a wrong one


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


def gravity(angle: Array) -> Array:
    """Return the columns of a load that depends on the angle (T,) of the link."""
    return np.column_stack([np.cos(angle), np.sin(angle)])
