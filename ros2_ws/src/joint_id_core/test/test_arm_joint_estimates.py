"""What a followed arm tells of its joints: what is known, and what is wrong with the samples."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.status import Status
from joint_id_core.results.verdict import Verdict

from . import moving_arm
from .moving_arm import CARRYING, CENTRE, COULOMB, DOWN, JOINTS, MASS, ROTOR, URDF, VISCOUS
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.description import Description
from joint_id_core.arm.follower import ArmFollower
from joint_id_core.arm.joint_estimates import joint_estimates, payload
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stream import ArmStream

ARM = Description(URDF, "arm.urdf")
REGRESSOR = Regressor(ARM)
GAINS = {name: {"torque": 1.0} for name in JOINTS}
LEARN = 22.0  # s of motion
LEANING = tuple(9.81 * np.array([np.sin(0.05), 0.0, -np.cos(0.05)]))  # by 2.9 degrees


def followed(arm: Mapping[str, Recording]) -> Iterator[ArmFollower]:
    """The arm after every tenth of a second."""
    stream = ArmStream(REGRESSOR, GAINS, "arm.urdf")
    follower = ArmFollower(JOINTS, ARM.mass, beforehand=Beforehand.of(REGRESSOR), description=ARM)
    for k in range(0, len(arm[JOINTS[0]]), 50):
        for block in stream.push({name: record.slice(k, k + 50) for name, record in arm.items()}):
            if follower.add(block) and follower.belief is not None:
                stream.know(follower.belief.values, follower.belief.carries)
        yield follower


def told(arm: Mapping[str, Recording]) -> dict[str, Estimate]:
    """What is told of an arm after its motion."""
    *_, follower = followed(arm)
    return joint_estimates(follower, REGRESSOR, "arm.urdf")


def holds(follower: ArmFollower, most: float = 4.0) -> None:
    """Check that values of all joints are at most so many standard deviations off."""
    found = joint_estimates(follower, REGRESSOR, "arm.urdf")
    for name, *values in zip(JOINTS, ROTOR, VISCOUS, COULOMB, strict=True):
        for parameter, true in zip(("J_r", "c", "tau_f", "tau_0"), (*values, 0.0), strict=True):
            row = found[name][parameter]
            estimated = row.verdict is Verdict.ESTIMATED
            assert not estimated or abs(row.value - true) < most * row.std_dev, (follower.time, name, row)


def test_a_joint_that_has_not_moved_says_so():
    found = told(moving_arm.rigid(LEARN, 1, standing=("bend",)))
    assert found["bend"].status is Status.NO_MOTION and "bend has not moved" in found["bend"].message
    assert all(found[name].converged for name in JOINTS if name != "bend")


@pytest.mark.long
@pytest.mark.parametrize(
    ("late", "gravity", "text"),
    first_quick(
        [
            (0.005, DOWN, r"torques seem to be (4\.[5-9]|5\.?[0-5]?) ms late"),
            (0.0, LEANING, r"turned by -2\.[7-9] degrees"),
        ]
    ),
    ids=["late torques", "a base that leans"],
)
def test_faults_of_the_samples_are_named_and_in_the_intervals(late, gravity, text):
    """They left rotors and offsets 19 and 14 standard deviations off, without a word."""
    *_, follower = followed(moving_arm.rigid(3.0 * LEARN, 2, late=late, gravity=gravity))
    for one in joint_estimates(follower, REGRESSOR, "arm.urdf").values():
        assert one.converged and re.search(text, one.message), one.message
    holds(follower)


@pytest.mark.long
def test_a_spring_is_in_the_intervals_at_any_time():
    """Between two fits of all motion, the offset of the lift was 3.8 standard deviations off."""
    arm = moving_arm.rigid(1.6 * LEARN, 2)
    own = arm["lift"]
    pulled = {**arm, "lift": own.with_channels({"torque": own["torque"] + 20.0 * own["link_position"]})}
    for k, follower in enumerate(followed(pulled)):
        if follower.belief is not None and k % 5 == 0:
            assert any("spring" in text for text in follower.belief.faults.texts)
            holds(follower, 3.0)


@pytest.mark.parametrize(("factor", "text"), first_quick([(1.2, "large"), (0.8, "small")]))
def test_a_torque_constant_that_is_off_is_named_and_in_the_intervals(factor, text):
    """All joints bear the same links: the offset of the bend was 26 standard deviations off, without a word."""
    arm = moving_arm.rigid(2.0 * LEARN, 2)
    *_, follower = followed({**arm, "bend": arm["bend"].with_channels({"torque": factor * arm["bend"]["torque"]})})
    for one in joint_estimates(follower, REGRESSOR, "arm.urdf").values():
        assert one.converged and f"torque of bend seems to be 1.2 times too {text}" in one.message, one.message
    holds(follower)


@pytest.mark.long
def test_a_payload_beside_a_base_that_leans_is_in_its_intervals():
    """It was 2.45 +- 0.013 kg where 2.5 is right, and offsets were 6 standard deviations off: the arm leant with it."""
    seconds, since = 2.0 * LEARN, 1.2 * LEARN
    free, loaded = (moving_arm.rigid(seconds, 2, urdf, gravity=LEANING) for urdf in (URDF, CARRYING))
    later = free["turn"].time > since
    arm = {n: r.with_channels({"torque": np.where(later, loaded[n]["torque"], r["torque"])}) for n, r in free.items()}
    weighed = 0
    for k, follower in enumerate(followed(arm)):
        if follower.belief is None or k % 5:
            continue
        holds(follower)
        found = payload(follower, REGRESSOR)
        if found is not None:
            weighed += 1
            off = (found.mass - MASS, *np.subtract(found.centre, CENTRE))
            sigma = (found.mass_std_dev, *found.centre_std_dev)
            assert found.known and np.all(np.abs(off) < 3.0 * np.array(sigma)), (follower.time, found)
            assert found.mass_std_dev < 0.05 * MASS
    assert weighed > 10


@pytest.mark.long
def test_a_motion_too_slow_to_tell_a_bend_from_a_line_has_both_in_its_intervals():
    found = told(moving_arm.rigid(2.0 * LEARN, 2, share=0.05))
    for name, *values in zip(JOINTS, VISCOUS, COULOMB, strict=True):
        for parameter, true in zip(("c", "tau_f"), values, strict=True):
            row = found[name][parameter]
            assert row.verdict is not Verdict.ESTIMATED or abs(row.value - true) < 4.0 * row.std_dev, (name, row)


def test_nothing_is_told_of_samples_without_a_fault():
    assert all(found.converged and "learnt" not in found.message for found in told(moving_arm.rigid(LEARN, 1)).values())


@pytest.mark.long
def test_a_torque_with_the_other_sign_is_no_good_fit():
    arm = moving_arm.rigid(LEARN, 2)
    found = told({**arm, "spin": arm["spin"].with_channels({"torque": -arm["spin"]["torque"]})})
    assert found["spin"].status is Status.POOR_FIT and "the other sign" in found["spin"].message


@pytest.mark.parametrize("seed", first_quick([2, 21]))
def test_a_torque_with_the_other_sign_makes_the_fit_of_no_joint_good(seed):
    """All joints bear the same masses: the neighbours of an elbow stayed `converged`, up to 46 sigma off."""
    arm = moving_arm.rigid(LEARN, seed)
    found = told({**arm, "bend": arm["bend"].with_channels({"torque": -arm["bend"]["torque"]})})
    for name in JOINTS:
        assert found[name].status is Status.POOR_FIT and "torque of bend seems" in found[name].message, found[name]


@pytest.mark.long
def test_an_axis_that_points_the_other_way_is_named_and_makes_the_fit_of_no_joint_good():
    arm = moving_arm.rigid(LEARN, 2)
    turned = {channel: -arm["bend"][channel] for channel in ("link_position", "torque")}
    found = told({**arm, "bend": arm["bend"].with_channels(turned)})
    for one in found.values():
        assert one.status is Status.POOR_FIT and "axis of bend seems to point the other way" in one.message, one


@pytest.mark.long
def test_torques_that_no_bodies_have_are_no_good_fit_of_any_joint():
    """As of a load that pushes upwards."""
    arm, carrying = moving_arm.rigid(LEARN, 2), moving_arm.rigid(LEARN, 2, CARRYING)
    lighter = {n: r.with_channels({"torque": 3.0 * r["torque"] - 2.0 * carrying[n]["torque"]}) for n, r in arm.items()}
    found = told(lighter)
    assert all(one.status is Status.POOR_FIT for one in found.values())
    assert "such as no bodies have" in found["roll"].message
