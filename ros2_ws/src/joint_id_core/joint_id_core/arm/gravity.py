"""Whether gravity acts where the fit of an arm takes it to: no description says how a base is mounted.

With the links of the description, torques of gravity are linear in its three components. These are found by least
squares, and compared with a gravity that has the direction taken and any size, as masses and torque constants may be
wrong. Rotors and friction are projected out (Frisch & Waugh). `gravity_direction` does it without torque constants.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import PAYLOAD, Equations
from joint_id_core.arm.gravity_direction import BETTER, INSTANTS, TURNED, G, listed, pull_of
from joint_id_core.arm.recorded_otherwise import recorded_otherwise
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import Stacked, centred, solved
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError


def check_gravity(description: Description, regressor: Regressor, parts: Sequence[Equations]) -> None:
    """Check the direction of gravity.

    Args:
        description: of the robot; `regressor`: of it.
        parts: equations of recordings without a payload.

    Raises:
        JointIdError: another direction explains the torques far better than the one that is taken.
    """
    table, taken = _table(description, regressor, parts), description.gravity
    felt, sigma = table.weighed()
    size = float(np.linalg.norm(felt))
    if not size > 0.0:
        return  # no joint bears the weight of a link
    weights = 1.0 / sigma[table.joint]
    y, columns = table.y * weights, table.columns * weights[:, None]
    along = columns @ taken
    left = float(np.sum((y - columns @ felt) ** 2))
    left_along = float(np.sum((y - along * np.maximum(0.0, solved(along[:, None], y))) ** 2))
    cosine = float(felt @ taken) / (size * max(float(np.linalg.norm(taken)), 1e-9))
    if left_along > BETTER * left and cosine < np.cos(np.radians(TURNED)):
        found, given = listed(G / size * felt), listed(taken)
        otherwise = recorded_otherwise(description, regressor, parts) or "correct the signs of the torques"
        raise JointIdError(
            f"the torques say that gravity acts along {found} m/s^2 in the frame of the base of {description.source}, "
            f"not along {given}: give the gravity of your base (--base-gravity, base_gravity), or "
            f"{otherwise}"
        )


def _table(description: Description, regressor: Regressor, parts: Sequence[Equations]) -> Stacked:
    """Return torques without those of motion, and what gravity does to them by axis of the base, for 1 m/s^2."""
    count = len(description.joints)
    pull_at = pull_of(description)
    tables: list[Array] = []
    for part in parts:
        rows = np.linspace(0, len(part.time) - 1, INSTANTS // len(parts)).astype(np.intp)
        q = part.q[rows]
        pull = pull_at(q)
        moved = part.columns[rows, :, : part.base] @ regressor.reference - pull @ description.gravity
        every = np.concatenate([(part.y[rows] - moved)[:, :, None], pull], axis=2)
        for j in range(count):
            used = part.used[rows, j]
            own = centred(part.columns[rows[used], j][:, [j, part.base + PAYLOAD + j, part.base + PAYLOAD + count + j]])
            some = centred(every[used, j])
            tables.append(some - own @ np.linalg.lstsq(own, some, rcond=None)[0])
    pieces = np.repeat(np.arange(len(tables)), [len(some) for some in tables])
    whole = np.concatenate(tables)
    return Stacked(whole[:, 0], whole[:, 1:], pieces % count, pieces, count)
