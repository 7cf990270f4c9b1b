"""Friction that turns over some distance: that of a contact before it slides, or of the flexspline of a gear."""

from __future__ import annotations

import numpy as np

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array


def hysteresis(position: Array, reach: float) -> Array:
    """Return Dahl's friction over its level along a position (T,), which approaches 1 exponentially over `reach`.

    Source: Dahl, A Solid Friction Model, Aerospace Corporation TOR-0158 (1968).
    """
    found = np.empty(len(position))
    compile_shared().turned(np.ascontiguousarray(position), reach, found)
    return found
