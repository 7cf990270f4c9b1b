"""The robots that are emulated: their names, sizes and true parameters. All of it is made up.

The joints are Model 2 of the paper, driven by a current. Table V describes one joint with a torque of 150 Nm; every
torque-like parameter of a joint is that of Table V in proportion to the joint's largest torque, and then changed by up
to 15 %, so that no two joints are alike and start values are wrong. No real UR joint has these values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive

JOINT_NAMES = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip
HOME = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)  # rad, around which the joints move
TABLE_V_TORQUE = 150.0  # Nm, see control.PositionController

# Largest joint torques in Nm, base to wrist 3, from the maker's table of joint sizes.
_TORQUES: dict[str, tuple[float, ...]] = {
    "ur3e": (56.0, 56.0, 28.0, 12.0, 12.0, 12.0),
    "ur5e": (150.0, 150.0, 150.0, 28.0, 28.0, 28.0),
    "ur10e": (330.0, 330.0, 150.0, 56.0, 56.0, 56.0),
}
_SCALED = ("J_m", "c_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq")
_SPREAD = 0.15
_BIG, _K_T_BIG, _K_T_SMALL = 100.0, 0.1, 0.08  # Nm, Nm/A: as in the calibration of a UR5e, see sensors.py

ROBOTS = tuple(_TORQUES)


@dataclass(frozen=True)
class Joint:
    """One joint: its name, its size as a share of the joint of Table V, its home position, its true parameters."""

    name: str
    size: float
    home: float
    values: dict[str, float]


def build_joints(robot: str) -> tuple[Joint, ...]:
    """The six joints of a robot, the same at every call.

    Raises:
        JointIdError: unknown robot.
    """
    if robot not in _TORQUES:
        raise JointIdError(f"unknown robot {robot!r}: choose one of {', '.join(ROBOTS)}")
    model = HarmonicDrive(actuation="current")
    rng = np.random.default_rng(ROBOTS.index(robot))
    joints = []
    for name, home, torque in zip(JOINT_NAMES, HOME, _TORQUES[robot], strict=True):
        size = torque / TABLE_V_TORQUE
        nominal = model.values({"k_t": _K_T_BIG if torque > _BIG else _K_T_SMALL})
        factors = size * rng.uniform(1.0 - _SPREAD, 1.0 + _SPREAD, len(_SCALED))
        changes = {p: float(f"{nominal[p] * f:.4g}") for p, f in zip(_SCALED, factors, strict=True)}
        joints.append(Joint(name, size, home, {**nominal, **changes}))
    return tuple(joints)
