"""What a followed arm tells of its joints: what is known, and what is wrong with the samples."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.status import Status
from joint_id_core.results.verdict import Verdict

from . import moving_arm
from .moving_arm import CARRYING, COULOMB, DOWN, JOINTS, ROTOR, URDF, VISCOUS

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
LEANING = tuple(9.81 * np.array([np.sin(0.05), 0.0, -np.cos(0.05)]))  # by 2.9 degrees


def told(arm: Mapping[str, Recording]) -> dict[str, Estimate]:
    """What is told of an arm after its motion."""
    stream = ArmStream(REGRESSOR, GAINS, "arm.urdf")
    follower = ArmFollower(JOINTS, ARM.mass, beforehand=Beforehand.of(REGRESSOR), description=ARM)
    for k in range(0, len(arm[JOINTS[0]]), 50):
        for block in stream.push({name: record.slice(k, k + 50) for name, record in arm.items()}):
            if follower.add(block) and follower.belief is not None:
                stream.know(follower.belief.values, follower.belief.carries)
    return joint_estimates(follower, REGRESSOR, "arm.urdf")


def test_a_joint_that_has_not_moved_says_so():
    found = told(moving_arm.rigid(LEARN, 1, standing=("bend",)))
    assert found["bend"].status is Status.NO_MOTION and "bend has not moved" in found["bend"].message
    assert all(found[name].converged for name in JOINTS if name != "bend")


@pytest.mark.parametrize(
    ("late", "gravity", "text"),
    [
        (0.005, DOWN, r"torques seem to be (4\.[5-9]|5\.?[0-5]?) ms late"),
        (0.0, LEANING, r"turned by -2\.[7-9] degrees"),
    ],
    ids=["late torques", "a base that leans"],
)
def test_faults_of_the_samples_are_named_and_in_the_intervals(late, gravity, text):
    """They left rotors and offsets 19 and 14 standard deviations off, without a word."""
    found = told(moving_arm.rigid(3.0 * LEARN, 2, late=late, gravity=gravity))
    truth = zip(JOINTS, ROTOR, VISCOUS, COULOMB, strict=True)
    for name, *values in truth:
        assert found[name].converged and re.search(text, found[name].message), found[name].message
        for parameter, true in zip(("J_r", "c", "tau_f", "tau_0"), (*values, 0.0), strict=True):
            row = found[name][parameter]
            assert row.verdict is not Verdict.ESTIMATED or abs(row.value - true) < 4.0 * row.std_dev, (name, row)


def test_a_motion_too_slow_to_tell_a_bend_from_a_line_has_both_in_its_intervals():
    found = told(moving_arm.rigid(2.0 * LEARN, 2, share=0.05))
    for name, *values in zip(JOINTS, VISCOUS, COULOMB, strict=True):
        for parameter, true in zip(("c", "tau_f"), values, strict=True):
            row = found[name][parameter]
            assert row.verdict is not Verdict.ESTIMATED or abs(row.value - true) < 4.0 * row.std_dev, (name, row)


def test_nothing_is_told_of_samples_without_a_fault():
    assert all(found.converged and "learnt" not in found.message for found in told(moving_arm.rigid(LEARN, 1)).values())


def test_a_torque_with_the_other_sign_is_no_good_fit():
    arm = moving_arm.rigid(LEARN, 2)
    found = told({**arm, "spin": arm["spin"].with_channels({"torque": -arm["spin"]["torque"]})})
    assert found["spin"].status is Status.POOR_FIT and "the other sign" in found["spin"].message


@pytest.mark.parametrize("seed", [2, 21])
def test_a_torque_with_the_other_sign_makes_the_fit_of_no_joint_good(seed):
    """All joints bear the same masses: the neighbours of an elbow stayed `converged`, up to 46 sigma off."""
    arm = moving_arm.rigid(LEARN, seed)
    found = told({**arm, "bend": arm["bend"].with_channels({"torque": -arm["bend"]["torque"]})})
    for name in JOINTS:
        assert found[name].status is Status.POOR_FIT and "torque of bend seems" in found[name].message, found[name]


def test_an_axis_that_points_the_other_way_is_named_and_makes_the_fit_of_no_joint_good():
    arm = moving_arm.rigid(LEARN, 2)
    turned = {channel: -arm["bend"][channel] for channel in ("link_position", "torque")}
    found = told({**arm, "bend": arm["bend"].with_channels(turned)})
    for one in found.values():
        assert one.status is Status.POOR_FIT and "axis of bend seems to point the other way" in one.message, one


def test_torques_that_no_bodies_have_are_no_good_fit_of_any_joint():
    """As of a load that pushes upwards."""
    arm, carrying = moving_arm.rigid(LEARN, 2), moving_arm.rigid(LEARN, 2, CARRYING)
    lighter = {n: r.with_channels({"torque": 3.0 * r["torque"] - 2.0 * carrying[n]["torque"]}) for n, r in arm.items()}
    found = told(lighter)
    assert all(one.status is Status.POOR_FIT for one in found.values())
    assert "such as no bodies have" in found["roll"].message
