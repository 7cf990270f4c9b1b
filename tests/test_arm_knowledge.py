"""What the node `arm_identifier` knows of an arm while it works."""

from __future__ import annotations

import numpy as np
import pytest
from core_arm import moving_arm

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.errors import JointIdError
from joint_id_ros.arm_knowledge import ArmKnowledge
from joint_id_ros.options.arm_identifier import ArmIdentifierOptions

LEARN_S, PUSH_S, STEP_S = 26.0, 6.0, 0.5


def test_there_is_something_to_tell_while_the_arm_moves_though_nothing_is_believed():
    arm = ArmKnowledge(Description(moving_arm.URDF), ArmIdentifierOptions(), lambda kind, text: None)
    record = moving_arm.rigid(LEARN_S + PUSH_S, 0)
    push = np.where(record["bend"].time > LEARN_S, 4.0, 0.0)  # Nm: no payload, and perhaps another friction
    record["bend"] = record["bend"].with_channels({"torque": record["bend"]["torque"] + push})
    learnt = round(LEARN_S * moving_arm.RATE)
    assert arm.add({name: r.slice(0, learnt) for name, r in record.items()})
    step, used, told = round(STEP_S * moving_arm.RATE), arm.follower.motion, []
    for k in range(learnt, len(record["bend"]) - step, step):
        told.append(arm.add({name: r.slice(k, k + step) for name, r in record.items()}))
    assert arm.follower.motion - used < PUSH_S - 3.0  # else this shows nothing
    assert all(told)


def test_an_arm_is_not_learnt_with_a_gravity_that_the_torques_contradict():
    upside_down = Description(moving_arm.URDF, gravity=(0.0, 0.0, 9.81))
    arm = ArmKnowledge(upside_down, ArmIdentifierOptions(), lambda kind, text: None)
    with pytest.raises(JointIdError, match=r"gravity acts along \S+,-9.8\d* .* base_gravity\)"):
        arm.add(moving_arm.rigid(LEARN_S, 0))
    assert arm.follower.belief is None
