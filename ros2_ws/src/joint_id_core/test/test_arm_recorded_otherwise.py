"""An arm that was recorded otherwise than it moves: the fault is found in the torques of all joints."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError

from . import moving_arm
from .moving_arm import JOINTS, URDF
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import unchecked
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.recorded_otherwise import recorded_otherwise
from joint_id_core.arm.regressor import Regressor
from joint_id_core.results.status import Status

ARM = Description(URDF, "arm.urdf")
REGRESSOR = Regressor(ARM)
KNOWN = Beforehand.of(REGRESSOR)
GAINS = {name: {"torque": 1.0} for name in JOINTS}
SECONDS = 12.0
POSITION, TORQUE = "link_position", "torque"
Arm = Mapping[str, Recording]


@pytest.fixture(scope="module")
def arm() -> dict[str, Recording]:
    return moving_arm.rigid(SECONDS, 2)


def exchanged(arm: Arm, one: str, other: str, *channels: str) -> dict[str, Recording]:
    """Return a recording with channels of two joints in the columns of each other."""
    pair = {one: arm[other], other: arm[one]}
    return {**arm, **{n: arm[n].with_channels({c: r[c] for c in channels}) for n, r in pair.items()}}


def changed(arm: Arm, joint: str, channel: str, factor: float = 1.0, more: float = 0.0) -> dict[str, Recording]:
    """Return a recording with a channel of a joint that is larger by a factor, and by an amount."""
    return {**arm, joint: arm[joint].with_channels({channel: factor * arm[joint][channel] + more})}


def told(arm: Arm) -> str:
    return recorded_otherwise(ARM, REGRESSOR, [unchecked(REGRESSOR, arm, GAINS, "arm.urdf")], KNOWN)


@pytest.mark.parametrize("seed", first_quick([1, 2, 3, 4]))
def test_nothing_is_told_of_an_arm_that_was_recorded_as_it_moves(seed):
    assert not told(moving_arm.rigid(SECONDS, seed))


def test_masses_that_a_description_has_wrong_are_no_fault_of_the_recording(arm):
    """A mass of it may be off by a factor of five."""
    wrong = URDF.replace('mass value="6.0"', 'mass value="1.2"').replace('mass value="1.0"', 'mass value="4.0"')
    assert wrong != URDF
    description = Description(wrong, "wrong.urdf")
    regressor = Regressor(description)
    assert not recorded_otherwise(description, regressor, [unchecked(regressor, arm, GAINS, "wrong.urdf")])


@pytest.mark.parametrize(
    ("channels", "text"),
    first_quick(
        [
            ((TORQUE,), "the torques of {} and {} seem to be exchanged"),
            ((POSITION,), "the positions of {} and {} seem to be exchanged"),
            ((POSITION, TORQUE), "{} and {} seem to be exchanged, with positions and torques"),
        ]
    ),
    ids=["torques", "positions", "both"],
)
@pytest.mark.parametrize(
    "pair",
    [
        ("turn", "lift"),
        pytest.param(("bend", "roll"), marks=pytest.mark.long),
        pytest.param(("tilt", "spin"), marks=pytest.mark.long),
    ],
)
def test_joints_that_are_exchanged_are_named(arm, pair, channels, text):
    assert told(exchanged(arm, *pair, *channels)) == text.format(*pair)


@pytest.mark.parametrize(
    ("joint", "factor"),
    [
        ("lift", 0.5),
        *(pytest.param(*one, marks=pytest.mark.long) for one in (("bend", 1000.0), ("turn", 2.0), ("tilt", 10.0))),
    ],
)
def test_a_torque_in_another_unit_is_named_with_its_factor(arm, joint, factor):
    found = told(changed(arm, joint, TORQUE, factor))
    size = re.match(rf"the torque of {joint} seems to be ([\d.e+]+) times too (large|small) \(unit", found)
    assert size is not None and size[2] == ("large" if factor > 1.0 else "small"), found
    assert float(size[1]) == pytest.approx(max(factor, 1.0 / factor), rel=0.1)


@pytest.mark.long
def test_torques_of_all_joints_in_another_unit_are_named(arm):
    """The masses of the description tell their size, roughly."""
    milli = dict(arm)
    for name in JOINTS:
        milli = changed(milli, name, TORQUE, 1000.0)
    assert told(milli).startswith(
        "the torques of all joints seem to be far too large for the masses of the description"
    )


@pytest.mark.parametrize("joint", [pytest.param("turn", marks=pytest.mark.long), "bend"])
@pytest.mark.parametrize(
    ("channels", "text"),
    first_quick(
        [
            ((TORQUE,), "the torque of {} seems to have the other sign"),
            ((POSITION,), "the position of {} seems to have the other sign"),
            ((POSITION, TORQUE), "the axis of {} seems to point the other way"),
        ],
    ),
    ids=["torque", "position", "both"],
)
def test_a_sign_is_that_of_the_torque_of_the_position_or_of_both(arm, joint, channels, text):
    for channel in channels:
        arm = changed(arm, joint, channel, -1.0)
    assert told(arm) == text.format(joint)


@pytest.mark.long
@pytest.mark.parametrize("joint", ["lift", pytest.param("spin", marks=pytest.mark.long)])
def test_a_position_in_degrees_is_named(arm, joint):
    assert told(changed(arm, joint, POSITION, 180.0 / np.pi)) == f"the position of {joint} seems to be in degrees"


@pytest.mark.parametrize(("joint", "degrees"), first_quick([("lift", 30.0), ("bend", 90.0), ("roll", -60.0)]))
def test_a_zero_that_is_far_off_is_named_with_its_angle(arm, joint, degrees):
    found = told(changed(arm, joint, POSITION, more=np.radians(degrees)))
    size = re.fullmatch(rf"the zero of {joint} seems to be off by (-?\d+) degrees", found)
    assert size is not None and float(size[1]) == pytest.approx(degrees, abs=3.0), found


def test_a_zero_that_is_near_is_left_to_suspects(arm):
    assert not told(changed(arm, "bend", POSITION, more=np.radians(5.0)))


@pytest.mark.long
def test_a_base_that_leans_is_left_to_suspects():
    """It makes the zero of the lift look wrong; `suspects` name the lean."""
    angle = np.radians(28.0)
    assert not told(moving_arm.rigid(SECONDS, 2, growth=0.1, gravity=(9.81 * np.sin(angle), 0, -9.81 * np.cos(angle))))


def test_the_zero_of_an_axis_along_gravity_is_nowhere(arm):
    assert not told(changed(arm, "turn", POSITION, more=1.0))


@pytest.mark.long
def test_two_faults_are_both_named(arm):
    found = told(changed(exchanged(arm, "lift", "bend", TORQUE), "turn", TORQUE, -1.0))
    assert "lift and bend seem to be exchanged" in found and "torque of turn seems to have the other sign" in found


@pytest.mark.long
def test_the_fit_of_a_whole_arm_is_none_of_any_joint_then(arm):
    """Rotors and masses are those of all: with a lift in another unit, three joints were converged and wrong."""
    found = fit_arm(ARM, [changed(arm, "lift", TORQUE, 0.5)], GAINS)
    assert found.status is Status.POOR_FIT and "torque of lift seems to be 2 times too small" in found.message


@pytest.mark.long
def test_a_fault_that_looks_like_another_gravity_is_told_beside_it():
    """The fit is refused before it is made, and so is the motion from which an arm would be learnt."""
    arm = changed(moving_arm.rigid(SECONDS, 3), "lift", POSITION, more=np.pi)
    with pytest.raises(
        JointIdError, match=r"gravity acts along .*, or the zero of lift seems to be off by 17\d degrees"
    ):
        fit_arm(ARM, [arm], GAINS)
