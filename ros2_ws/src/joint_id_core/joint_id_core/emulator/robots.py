"""The emulated robots: names, sizes and true parameters. All values are fictitious.

A joint is Model 2 of the paper driven by a current. Its inertia, stiffness, damping and friction are those of Table V
times a size, and changed by up to 15 % at random. So no two joints are equal, and the nominal values are wrong for all
of them. The sizes only reflect that wrists are smaller and a UR10e is larger than a UR3e: no real UR joint has these
values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive
from joint_id_core.rtde.fields import JOINT_NAMES

HOME = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)  # rad, around which the joints move
# Base to wrist 3. Smaller joints would need currents below the noise of the sensor.
_SIZES: dict[str, tuple[float, ...]] = {
    "ur3e": (1.0, 1.0, 0.8, 0.6, 0.6, 0.6),
    "ur5e": (1.4, 1.4, 1.4, 0.8, 0.8, 0.8),
    "ur10e": (1.8, 1.8, 1.4, 1.0, 1.0, 1.0),
}
_K_T = (0.1, 0.1, 0.1, 0.08, 0.08, 0.08)  # Nm/A, rounded from the manufacturer's calibration of a UR5e
_SCALED = ("J_m", "c_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq")
_SPREAD = 0.15

ROBOTS = tuple(_SIZES)


@dataclass(frozen=True)
class Joint:
    """One joint: name, size relative to the joint of Table V, home position in rad, true parameters in SI units."""

    name: str
    size: float
    home: float
    values: dict[str, float]


def build_joints(robot: str) -> tuple[Joint, ...]:
    """Return the six joints of a robot; every call returns the same values.

    Raises:
        JointIdError: unknown robot.
    """
    if robot not in _SIZES:
        raise JointIdError(f"unknown robot {robot!r}: choose one of {', '.join(ROBOTS)}")
    model = HarmonicDrive(actuation="current")
    rng = np.random.default_rng(ROBOTS.index(robot))
    joints = []
    for name, home, size, k_t in zip(JOINT_NAMES, HOME, _SIZES[robot], _K_T, strict=True):
        nominal = model.values({"k_t": k_t})
        factors = size * rng.uniform(1.0 - _SPREAD, 1.0 + _SPREAD, len(_SCALED))
        changes = {p: float(f"{nominal[p] * f:.4g}") for p, f in zip(_SCALED, factors, strict=True)}
        joints.append(Joint(name, size, home, {**nominal, **changes}))
    return tuple(joints)


def with_links(joints: Sequence[Joint], names: Sequence[str]) -> tuple[Joint, ...]:
    """Return the joints with other names, and without an inertia of the link: it is that of the links they move."""
    pairs = zip(joints, names, strict=True)
    return tuple(replace(j, name=n, values={p: v for p, v in j.values.items() if p != "J_q"}) for j, n in pairs)
