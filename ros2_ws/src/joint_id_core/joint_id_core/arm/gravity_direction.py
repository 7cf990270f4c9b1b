"""The direction in which gravity acts on an arm, from torques or currents whose constants nobody knows.

With the links of the description, torques of gravity are linear in its three components. Each joint has a factor of its
own, so only a direction is found. Rotors, friction and the torques of motion are projected out (Frisch & Waugh).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.arm.description import GRAVITY, Description
from joint_id_core.arm.equations import DRIVES
from joint_id_core.arm.motion import motion
from joint_id_core.arm.stacked import centred
from joint_id_core.data.recording import Array, Recording

INSTANTS, LEAST = 300, 30  # of all recordings; of one joint in one of them
# Another direction is told if it leaves so many times less of the torques, and is so many degrees away. With the stock
# description of a UR10e and gravity 45 degrees off it is 30 times, with links whose centres are anywhere 2.5 times.
BETTER, TURNED = 6.0, 40.0
NEAR = 10.0  # degrees from an axis of the base within which that axis is told
DIRECTIONS, ROUNDS = 400, 10  # that are tried, and rounds that refine the best one
SHOWN = 0.01  # least information on a direction, over the most, with which torques tell it; one joint alone does not
G = float(np.linalg.norm(GRAVITY))


@dataclass(frozen=True)
class Pulled:
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


def other_gravity(description: Description, records: Sequence[Mapping[str, Recording]]) -> str:
    """Return that gravity acts elsewhere than it is taken to, as a sentence; empty if the torques do not say so.

    Args:
        description: of the robot.
        records: recordings of all its joints, by name. Joints without a torque or a current do not count.
    """
    return doubt(description, _pulled(description, records), "--base-gravity", lambda g: f" {listed(g)}")


def doubt(description: Description, joints: Sequence[Pulled], option: str, given: Callable[[Array], str]) -> str:
    """Return that gravity acts elsewhere than it is taken to, as a sentence; empty if the joints do not say so.

    Args:
        description: of the robot; `joints`: of it, as far as gravity loads them and their drive is known.
        option: with which a user gives a gravity; `given` returns what stands behind it for one in m/s^2, shape (3,).
    """
    taken = description.gravity
    if not joints or not taken.any():
        return ""
    felt, sure = _felt(joints)
    cosine = float(felt @ taken) / float(np.linalg.norm(taken))
    if _left(joints, taken) <= BETTER * _left(joints, felt) or cosine >= np.cos(np.radians(TURNED)):
        return ""
    axis = np.round(felt)
    found = G * (axis if float(felt @ axis) > np.cos(np.radians(NEAR)) else felt)
    what = f"along {listed(found)} m/s^2" if sure else "along another direction"
    give = f"{option}{given(found)}" if sure else f"its direction with {option}"
    return (
        f"The torques of all joints fit gravity {what} in the frame of the base of {description.source}, not along "
        f"{listed(taken)}: give {give} if the base is mounted so; a tool that the description lacks, or torques with "
        "the wrong sign, look alike."
    )


def pulled(
    description: Description, pull_at: Callable[[Array], Array], moved: Sequence[Array], drives: Mapping[int, Array]
) -> list[Pulled]:
    """Return the joints of one stretch of motion, without those that gravity does not load.

    Args:
        description: of the robot; `pull_at`: see `pull_of`.
        moved: positions, velocities and accelerations of its joints, each of shape (T, joints).
        drives: torques or currents, shape (T,), by the number of the joint; NaN where they are not known.
    """
    q, dq, ddq = moved
    pull = pull_at(q)
    links = description.loads(q, dq, ddq).torque - pull @ description.gravity
    found = []
    for j, drive in drives.items():
        told = np.isfinite(drive)
        if np.count_nonzero(told) < LEAST:
            continue
        own = centred(np.column_stack([ddq[:, j], dq[:, j], np.sign(dq[:, j]), links[:, j]])[told])
        some = centred(np.column_stack([drive, pull[:, j]])[told])
        some = some - own @ np.linalg.lstsq(own, some, rcond=None)[0]
        table, y = some[:, 1:], some[:, 0]
        sigma = float(np.std(y - table @ np.linalg.lstsq(table, y, rcond=None)[0]))
        if np.isfinite(sigma) and sigma > 0.0 and np.ptp(pull[:, j], axis=0).max() > 0.0:
            found.append(Pulled(table.T @ table, table.T @ y, float(y @ y), sigma))
    return found


def pull_of(description: Description, payload: tuple[float, Array] | None = None) -> Callable[[Array], Array]:
    """Return a function of positions (T, joints): what gravity of 1 m/s^2 along each axis does, (T, joints, 3).

    `payload`: as for `Description`.
    """
    axes = [Description(description.text, description.source, axis, payload) for axis in G * np.eye(3)]

    def at(q: Array) -> Array:
        still = np.zeros_like(q)
        return np.stack([axis.loads(q, still, still).torque / G for axis in axes], axis=2)

    return at


def listed(gravity: Array) -> str:
    """Return a gravity as command lines take it."""
    return ",".join(f"{v:.3g}" for v in np.round(gravity, 2) + 0.0)


def _pulled(description: Description, records: Sequence[Mapping[str, Recording]]) -> list[Pulled]:
    """Return the joints of recordings whose drive is known."""
    pull_at, found = pull_of(description), list[Pulled]()
    for record in records:
        first = record[description.joints[0]]
        q, dq, ddq = motion(record, description.joints, first, description.source)
        known = np.flatnonzero(np.isfinite(ddq).all(axis=1))
        if not len(known):
            continue
        count = max(2 * LEAST, INSTANTS // len(records))
        rows = known[np.linspace(0, len(known) - 1, count).astype(np.intp)]
        drives = {}
        for j, name in enumerate(description.joints):
            if drive := next((d for d in DRIVES if record[name].measured(d)), None):
                time = record[name].time + float(record[name].origin - first.origin)
                drives[j] = np.interp(first.time[rows], time, record[name][drive])
        found += pulled(description, pull_at, (q[rows], dq[rows], ddq[rows]), drives)
    return found


def _felt(joints: Sequence[Pulled]) -> tuple[Array, bool]:
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


def _left(joints: Sequence[Pulled], gravity: Array) -> float:
    return sum(one.left(gravity) for one in joints)
