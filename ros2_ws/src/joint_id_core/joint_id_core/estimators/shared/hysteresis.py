"""Friction that turns over some distance: that of a contact before it slides, or of the flexspline of a gear."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array


def hysteresis(position: Array, reach: float) -> Array:
    """Return Dahl's friction over its level along a position (T,), which approaches 1 exponentially over `reach`.

    Source: Dahl, A Solid Friction Model, Aerospace Corporation TOR-0158 (1968).
    """
    step = np.nan_to_num(np.diff(position, prepend=position[:1]))
    sign = np.sign(step)
    state, found = 0.0, np.zeros(len(position))
    begins = np.flatnonzero(np.diff(sign, prepend=np.nan) != 0.0)
    for begin, end in zip(begins, [*begins[1:], len(position)], strict=True):
        way = np.abs(np.cumsum(step[begin:end]))
        found[begin:end] = sign[begin] - (sign[begin] - state) * np.exp(-way / reach)
        if sign[begin] == 0.0:
            found[begin:end] = state
        state = found[end - 1]
    return found
