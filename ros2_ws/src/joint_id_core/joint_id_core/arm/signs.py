"""Whether the torque of a joint was recorded with the other sign: then all joints are explained once it is turned.

What is left of one joint is large then, and that pulls the masses and rotors of the others away, which seem to be
explained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.arm.fit import LEAST_R_SQUARED
from joint_id_core.arm.stacked import Stacked


def other_sign(table: Stacked, joints: Sequence[str]) -> str:
    """Return that the torque of one of the joints seems to have the other sign; empty if none does."""
    explained, left = _explained(table)
    if explained:
        return ""
    found = ""
    for j, name in enumerate(joints):  # neighbours whose torque is turned may explain it, too: not as well
        explained, less = _explained(replace(table, y=np.where(table.joint == j, -table.y, table.y)))
        if explained and less < left:
            found, left = f"the torque of {name} seems to have the other sign", less
    return found


def _explained(table: Stacked) -> tuple[bool, float]:
    """Return whether the torque of every joint that moves is, and the mean logarithm of what is left."""
    values, _ = table.weighed()
    moves = np.bincount(table.joint, minlength=table.count) > 0
    left, whole = table.scatter(table.y - table.columns @ values), table.scatter(table.y)
    r_squared = (1.0 - (left / whole) ** 2)[moves]
    return bool(np.all(r_squared > LEAST_R_SQUARED)), float(np.mean(np.log(left[table.joint])))
