"""Which methods fit the arm, and what they make of its logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from joint_id_core.arm.description import Description
from robots.arm_peers.found import Method
from robots.arm_peers.logs import Log, without_meshes
from robots.arm_peers.process import fitted
from robots.recordings import DATA, UR10E_ALL, ur10e

OURS = "joint_id"
METHODS = {OURS: "ours", "plain IDIM-LS": "idim", "FIGAROH": "figaroh_wls", "mujoco.sysid": "mujoco_sysid"}
LIMIT_S = 120.0  # processor time of a fit of one log


def methods(limit_s: float = LIMIT_S) -> list[Method]:
    """Fit each log by each method, one after the other."""
    urdf = without_meshes((DATA / "ur10e/ur10e.urdf").read_text(encoding="utf-8"))
    joints = Description(urdf).joints
    logs = [arm_log(name, joints) for name in UR10E_ALL]
    found = []
    for name, module in METHODS.items():
        found.append(fitted(name, f"robots.arm_peers.{module}", urdf, logs, limit_s))
        print(f"{found[-1].name}: {len(found[-1].fits)} fits of the arm {found[-1].failed}", flush=True)
    return found


def arm_log(name: str, joints: Sequence[str]) -> Log:
    """A log of the UR10e with all joints."""
    return Log.of({joint: replace(ur10e(name, k), joint=joint) for k, joint in enumerate(joints, 1)})
