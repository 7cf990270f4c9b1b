"""Whether gravity acts where it is taken to: no description says how the base of a robot is mounted.

With the links of the description, torques of gravity are linear in its three components. These are found by least
squares, and compared with a gravity that has the direction taken and any size, as masses and torque constants may be
wrong. Rotors and friction are projected out (Frisch & Waugh). Where the torque constants are not known, as for the load
of one joint, each joint has a factor of its own, and only a direction is found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.arm.description import GRAVITY, Description
from joint_id_core.arm.equations import DRIVES, PAYLOAD, Equations
from joint_id_core.arm.motion import motion
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import Stacked, centred, solved
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError

INSTANTS, LEAST = 300, 30  # of all recordings; of one joint in one of them
# Another direction is told if it leaves so many times less of the torques, and is so many degrees away. With the stock
# description of a UR10e and gravity 45 degrees off it is 30 times, with links whose centres are anywhere 2.5 times.
BETTER, TURNED = 6.0, 40.0
NEAR = 10.0  # degrees from an axis of the base within which that axis is told
DIRECTIONS, ROUNDS = 400, 10  # that are tried, and rounds that refine the best one
SHOWN = 0.01  # least information on a direction, over the most, with which torques tell it; one joint alone does not
G = float(np.linalg.norm(GRAVITY))


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
        found, given = _listed(G / size * felt), _listed(taken)
        raise JointIdError(
            f"the torques say that gravity acts along {found} m/s^2 in the frame of the base of {description.source}, "
            f"not along {given}: give the gravity of your base (--base-gravity, base_gravity), or correct the signs "
            "of the torques"
        )


def other_gravity(description: Description, records: Sequence[Mapping[str, Recording]]) -> str:
    """Return that gravity acts elsewhere than it is taken to, as a sentence; empty if the torques do not say so.

    Args:
        description: of the robot.
        records: recordings of all its joints, by name. Joints without a torque or a current do not count.
    """
    joints, taken = _pulled(description, records), description.gravity
    if not joints or not taken.any():
        return ""
    felt, sure = _felt(joints)
    cosine = float(felt @ taken) / float(np.linalg.norm(taken))
    if _left(joints, taken) <= BETTER * _left(joints, felt) or cosine >= np.cos(np.radians(TURNED)):
        return ""
    axis = np.round(felt)
    found = _listed(G * (axis if float(felt @ axis) > np.cos(np.radians(NEAR)) else felt))
    what = f"along {found} m/s^2" if sure else "along another direction"
    give = f"--base-gravity {found}" if sure else "its direction with --base-gravity"
    return (
        f"The torques of all joints fit gravity {what} in the frame of the base of {description.source}, not along "
        f"{_listed(taken)}: give {give} if the base is mounted so; a tool that the description lacks, or torques with "
        "the wrong sign, look alike."
    )


def _felt(joints: Sequence[_Pulled]) -> tuple[Array, bool]:
    """Return the direction of gravity that leaves least of the torques, shape (3,), and whether it is the only one."""
    at = np.arange(DIRECTIONS) + 0.5  # of a spiral from pole to pole, which is nearly even
    up, around = 1.0 - 2.0 * at / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * at
    level = np.sqrt(1.0 - up * up)
    spiral = np.column_stack([level * np.cos(around), level * np.sin(around), up])
    felt = spiral[np.argmin([_left(joints, g) for g in spiral])]
    for _ in range(ROUNDS):
        scales = [one.scale(felt) for one in joints]
        parts = [(c / one.sigma) ** 2 * one.matrix for c, one in zip(scales, joints, strict=True)]
        vector = np.sum([c / one.sigma**2 * one.vector for c, one in zip(scales, joints, strict=True)], axis=0)
        matrix = np.sum(parts, axis=0)
        felt = np.linalg.lstsq(matrix, vector, rcond=SHOWN)[0]
        felt = felt / max(float(np.linalg.norm(felt)), 1e-12)
    least, _, most = np.linalg.eigvalsh(matrix)
    return felt, bool(least > SHOWN * most)


@dataclass(frozen=True)
class _Pulled:
    """Torques y of a joint beside what gravity of 1 m/s^2 along each axis does to it, W, in sums over instants.

    Attributes:
        matrix, vector, square: W'W, W'y and y'y, shapes (3, 3), (3,) and ().
        sigma: standard deviation of what any gravity leaves of y.
    """

    matrix: Array
    vector: Array
    square: float
    sigma: float

    def scale(self, gravity: Array) -> float:
        """Return the factor on the pull of a gravity that fits best, 0 or more."""
        return max(0.0, float(self.vector @ gravity)) / max(float(gravity @ self.matrix @ gravity), 1e-12)

    def left(self, gravity: Array) -> float:
        """Return what a gravity leaves of y'y, over the variance that any leaves."""
        return (self.square - self.scale(gravity) * max(0.0, float(self.vector @ gravity))) / self.sigma**2


def _left(joints: Sequence[_Pulled], gravity: Array) -> float:
    return sum(one.left(gravity) for one in joints)


def _pull(description: Description) -> Callable[[Array], Array]:
    """Return a function of positions (T, joints): what gravity of 1 m/s^2 along each axis does, (T, joints, 3)."""
    axes = [Description(description.text, description.source, axis) for axis in G * np.eye(3)]

    def at(q: Array) -> Array:
        still = np.zeros_like(q)
        return np.stack([axis.loads(q, still, still).torque / G for axis in axes], axis=2)

    return at


def _pulled(description: Description, records: Sequence[Mapping[str, Recording]]) -> list[_Pulled]:
    """Return the joints of recordings whose drive is known, without those that gravity does not load."""
    pull_at = _pull(description)
    found = []
    for record in records:
        first = record[description.joints[0]]
        q, dq, ddq = motion(record, description.joints, first, description.source)
        known = np.flatnonzero(np.isfinite(ddq).all(axis=1))
        if not len(known):
            continue
        count = max(2 * LEAST, INSTANTS // len(records))
        rows = known[np.linspace(0, len(known) - 1, count).astype(np.intp)]
        q, dq, ddq = q[rows], dq[rows], ddq[rows]
        pull = pull_at(q)
        moved = description.loads(q, dq, ddq).torque - pull @ description.gravity
        for j, name in enumerate(description.joints):
            drive = next((d for d in DRIVES if record[name].measured(d)), None)
            if drive is None:
                continue
            time = record[name].time + float(record[name].origin - first.origin)
            y = np.interp(first.time[rows], time, record[name][drive])
            told = np.isfinite(y)
            if np.count_nonzero(told) < LEAST:
                continue
            own = centred(np.column_stack([ddq[:, j], dq[:, j], np.sign(dq[:, j]), moved[:, j]])[told])
            some = centred(np.column_stack([y, pull[:, j]])[told])
            some = some - own @ np.linalg.lstsq(own, some, rcond=None)[0]
            table, y = some[:, 1:], some[:, 0]
            sigma = float(np.std(y - table @ np.linalg.lstsq(table, y, rcond=None)[0]))
            if np.isfinite(sigma) and sigma > 0.0 and np.ptp(pull[:, j], axis=0).max() > 0.0:
                found.append(_Pulled(table.T @ table, table.T @ y, float(y @ y), sigma))
    return found


def _listed(gravity: Array) -> str:
    return ",".join(f"{v:.3g}" for v in np.round(gravity, 2) + 0.0)


def _table(description: Description, regressor: Regressor, parts: Sequence[Equations]) -> Stacked:
    """Return torques without those of motion, and what gravity does to them by axis of the base, for 1 m/s^2."""
    count = len(description.joints)
    pull_at = _pull(description)
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
