"""Recordings of the emulated robot with the links of a URDF, and the truth about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.data.recording import Array, Recording
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.robots import build_joints, with_links
from joint_id_core.rtde.fields import JOINTS

from .moving_arm import URDF

ROBOT, PEAK, RATIO = "ur5e", 1.0, 101.0  # rad
ARM = Description(URDF, "arm.urdf")
DRIVES = with_links(build_joints(ROBOT), ARM.joints)
VALUES = {name: np.array([j.values[name] for j in DRIVES]) for name in DRIVES[0].values}
GAINS = {j.name: {"current": RATIO * j.values["k_t"]} for j in DRIVES}
# What a rigid arm has at the link: rotor, viscous and Coulomb friction, shape (6, 3).
AT_LINK = np.array(
    [
        RATIO**2 * VALUES["J_m"],
        RATIO**2 * VALUES["c_m"] + VALUES["c_q"],
        RATIO * VALUES["tau_fm"] + VALUES["tau_fq"],
    ]
).T
SHOWN = ("actual_q", "actual_qd", "actual_current", "target_q")


def built(moving: Sequence[int] = range(JOINTS), amplitude: float = PEAK, urdf: Description = ARM) -> Controller:
    """The robot."""
    return Controller(DRIVES, moving, amplitude, (5, 13, 0, 0), description=urdf)


def run(controller: Controller, seconds: float) -> dict[str, Array]:
    """What it reports, shape (T, 6) by field, and (T,) the timestamps; true velocities of the links."""
    rows = []
    for _ in range(round(seconds * 500)):
        controller.tick()
        controller.report()
        motor = [controller.values[f"output_double_register_{k}"] for k in range(24, 30)]
        row = {name: controller.values[name] for name in SHOWN}
        rows.append(
            {**row, "motor": motor, "speed": controller.arm.joints.link_velocity, "current": controller.arm.current}
        )
        rows[-1]["timestamp"] = controller.values["timestamp"]
        controller.advance()
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def recordings(shown: dict[str, Array]) -> dict[str, Recording]:
    """What the driver makes of it, by joint."""
    found = {}
    for k, name in enumerate(ARM.joints):
        channels = {
            "link_position": shown["actual_q"][:, k],
            "motor_position": shown["motor"][:, k],
            "motor_velocity": RATIO * shown["actual_qd"][:, k],
            "current": shown["actual_current"][:, k],
        }
        found[name] = Recording(shown["timestamp"], channels, source="emulated arm", joint=name)
    return found


def values_of(found: ArmEstimate) -> tuple[Array, Array]:
    """Rotor, viscous and Coulomb friction and their standard deviations, shape (6, 3)."""
    rows = [(j.armature, j.damping, j.friction) for j in found.joints]
    return np.array([[v.value for v in row] for row in rows]), np.array([[v.std_dev for v in row] for row in rows])
