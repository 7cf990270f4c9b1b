"""What a followed arm tells of its joints: what is known, and what is wrong with the samples."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.status import Status

from . import moving_arm
from .moving_arm import JOINTS, URDF

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.description import Description
from joint_id_core.arm.follower import ArmFollower
from joint_id_core.arm.joint_estimates import joint_estimates
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stream import ArmStream

ARM = Description(URDF, "arm.urdf")
REGRESSOR = Regressor(ARM)
GAINS = {name: {"torque": 1.0} for name in JOINTS}
LEARN = 22.0  # s of motion


def told(arm: Mapping[str, Recording]) -> dict[str, Estimate]:
    """What is told of an arm after its motion."""
    stream = ArmStream(REGRESSOR, GAINS, "arm.urdf")
    follower = ArmFollower(JOINTS, ARM.mass, beforehand=Beforehand.of(REGRESSOR))
    for k in range(0, len(arm[JOINTS[0]]), 50):
        for block in stream.push({name: record.slice(k, k + 50) for name, record in arm.items()}):
            if follower.add(block) and follower.belief is not None:
                stream.know(follower.belief.values, follower.belief.carries)
    return joint_estimates(follower, REGRESSOR, "arm.urdf")


def test_a_joint_that_has_not_moved_says_so():
    found = told(moving_arm.rigid(LEARN, 1, standing=("bend",)))
    assert found["bend"].status is Status.NO_MOTION and "bend has not moved" in found["bend"].message
    assert all(found[name].converged for name in JOINTS if name != "bend")
