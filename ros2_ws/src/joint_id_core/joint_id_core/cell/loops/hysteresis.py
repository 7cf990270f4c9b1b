"""Friction along a path that turns over some distance, compiled like `loops.information`."""

from __future__ import annotations

import math

from joint_id_core.cell.loops.arrays import Vector


def turned(position: Vector, reach: float, found: Vector) -> None:
    """Write Dahl's friction over its level along a position (T,) to `found` (T,): see `shared.hysteresis`.

    Where a position is missing, nothing moves.
    """
    state = 0.0
    for t in range(len(position)):
        step = position[t] - position[t - 1] if t > 0 else 0.0
        if step > 0.0:
            state = 1.0 - (1.0 - state) * math.exp(-step / reach)
        elif step < 0.0:
            state = -1.0 + (1.0 + state) * math.exp(step / reach)
        found[t] = state
