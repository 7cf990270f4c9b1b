"""The load that an arm puts on one of its joints: against closed forms and MuJoCo, and what fits make of it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Regression, fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Status

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, ONE_QUICK, ROTOR, URDF, VISCOUS, Motion, joint, link
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import Loaded, loaded
from joint_id_core.arm.typical_inertia import typical_inertia

RIGID = build("rigid_joint")


def states(count: int, seed: int = 0) -> Motion:
    """Unrelated positions, velocities and accelerations."""
    return Motion(*np.random.default_rng(seed).uniform(-2.0, 2.0, (3, count, len(JOINTS))))


def agree(description: Description, motion: Motion, torques: np.ndarray, joints=JOINTS) -> None:
    """Load and own inertia together are the torques of inverse dynamics."""
    for k, name in enumerate(joints):
        load = description.load(name, motion.q, motion.dq, motion.ddq)
        np.testing.assert_allclose(load.torque + load.inertia * motion.ddq[:, k], torques[:, k], rtol=1e-9, atol=1e-9)


# Masses (kg), length of the first link (m), centres of mass (m) and inertias about them (kg m^2).
TWO_LINKS = (3.0, 2.0), 0.5, (0.2, 0.3), (0.05, 0.02)


def two_links() -> str:
    """The URDF of the arm with these links."""
    m, length, centre, inertia = TWO_LINKS
    bodies = "".join(
        f'<link name="{n}"><inertial><origin xyz="{c} 0 0"/><mass value="{mass}"/><inertia ixx="0.001" iyy="{i}" '
        f'izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for n, mass, c, i in zip("ab", m, centre, inertia, strict=True)
    )
    joints = joint("one", "base", "a", "", "0 -1 0") + joint("two", "a", "b", f'xyz="{length} 0 0"', "0 -1 0")
    return f'<robot name="two"><link name="base"/>{bodies}{joints}</robot>'


def test_the_load_is_that_of_the_two_link_arm_of_the_textbook():
    """Siciliano et al., Robotics: Modelling, Planning and Control, 2009, section 7.3.2."""
    (m, length, centre, inertia), g = TWO_LINKS, 9.81
    rng = np.random.default_rng(3)
    q, dq, ddq = rng.uniform(-2.0, 2.0, (3, 20, 2))
    c2, s2 = np.cos(q[:, 1]), np.sin(q[:, 1])
    b22 = inertia[1] + m[1] * centre[1] ** 2
    b12 = b22 + m[1] * length * centre[1] * c2
    b11 = inertia[0] + m[0] * centre[0] ** 2 + m[1] * (length**2 + 2.0 * length * centre[1] * c2) + b22
    h = m[1] * length * centre[1] * s2
    tip = m[1] * centre[1] * g * np.cos(q.sum(axis=1))
    gravity = (m[0] * centre[0] + m[1] * length) * g * np.cos(q[:, 0]) + tip
    first = b12 * ddq[:, 1] - h * (2.0 * dq[:, 0] * dq[:, 1] + dq[:, 1] ** 2) + gravity
    second = b12 * ddq[:, 0] + h * dq[:, 0] ** 2 + tip
    description = Description(two_links())
    assert description.joints == ("one", "two")
    for name, torque, own in (("one", first, b11), ("two", second, np.full(20, b22))):
        load = description.load(name, q, dq, ddq)
        np.testing.assert_allclose(load.torque, torque, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(load.inertia, own, rtol=1e-9)


def test_the_load_is_that_of_another_library():
    motion = states(40)
    agree(Description(URDF), motion, moving_arm.inverse(motion))


def test_a_base_on_a_wall_has_its_own_gravity():
    wall = (9.81, 0.0, 0.0)
    motion = states(20)
    agree(Description(URDF, gravity=wall), motion, moving_arm.inverse(motion, gravity=wall))


def test_joints_that_follow_another_one_move_with_it():
    fingers = (
        link("left", 0.2, (0.0, 0.05, 0.02), 1e-4)
        + link("right", 0.2, (0.0, -0.05, 0.02), 1e-4)
        + joint("close", "tool", "left", 'xyz="0 0 0.1"', "0 1 0", "prismatic")
        + joint("other", "tool", "right", 'xyz="0 0 0.1"', "0 1 0", "prismatic", "{}")
    )
    follows = '<mimic joint="close" multiplier="-1.5" offset="0.01"/>'
    both = Description(URDF.replace("</robot>", f"{fingers.replace('{}', follows)}</robot>"))
    apart = Description(URDF.replace("</robot>", f"{fingers.replace('{}', '')}</robot>"))
    assert both.joints == (*JOINTS, "close") and apart.joints == (*JOINTS, "close", "other")
    q, dq, ddq = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 10, 7))
    other = [np.column_stack([v, -1.5 * v[:, 6] + offset]) for v, offset in ((q, 0.01), (dq, 0.0), (ddq, 0.0))]
    for name in ("turn", "spin"):
        one, two = both.load(name, q, dq, ddq), apart.load(name, *other)
        np.testing.assert_allclose(one.torque, two.torque, rtol=1e-12)
    for name in ("close", "other"):
        with pytest.raises(JointIdError, match="follows"):
            both.require(name)


# --- fits


@pytest.fixture(scope="module")
def rigid() -> dict[str, Recording]:
    return moving_arm.rigid(20.0)


def test_a_load_of_wrong_masses_that_is_not_matched_is_told_with_what_to_do():
    """As live, where nothing is known of the errors of the load."""
    twice = re.sub(r'mass value="([^"]*)"', lambda found: f'mass value="{2.0 * float(found[1])}"', URDF)
    record = loaded(Description(twice, "heavy.urdf"), "bend", [moving_arm.rigid(12.0, 0)]).recordings[0]
    record = replace(record, load_errors=None)
    estimate = fit(build("rigid_joint"), record, estimator=Regression())
    assert estimate.status is Status.POOR_FIT
    assert "joint-id arm fit --out" in estimate.message and "--urdf" not in estimate.message


@pytest.mark.parametrize("estimator", [None, Regression()], ids=["innovations", "regression"])
@pytest.mark.parametrize("name", ONE_QUICK)
def test_a_rigid_joint_is_found_while_all_joints_move(rigid, name, estimator):
    found, k = loaded(Description(URDF), name, [rigid]), JOINTS.index(name)
    options = {"estimator": estimator} if estimator else {}
    estimate = fit(RIGID, found.recordings[0], **options)
    assert estimate.converged, estimate.message
    for parameter, truth in (("J", ROTOR[k] + found.inertia), ("c", VISCOUS[k]), ("tau_f", COULOMB[k])):
        row = estimate[parameter]
        assert abs(row.value - truth) < 4.0 * row.std_dev, (parameter, row, truth)
        assert row.std_dev < 0.02 * truth


def test_a_single_joint_with_a_vertical_axis_has_no_load_that_could_be_off():
    """Its fit with the description ended in a traceback."""
    turn = joint("turn", "base", "a", "", "0 0 1")
    one = f'<robot name="one"><link name="base"/>{link("a", 2.0, (0.1, 0.0, 0.2), 0.01)}{turn}</robot>'
    record = moving_arm.rigid(6.0, 0)["turn"]
    found = loaded(Description(one, "one.urdf"), "turn", [{"turn": record}])
    assert found.rms < 1e-9 and found.recordings[0].load_errors is None
    assert fit(RIGID, found.recordings[0], estimator=Regression()).free


def test_without_the_load_it_is_not():
    """Otherwise the tests above would show nothing."""
    estimate = fit(RIGID, moving_arm.rigid(20.0)["lift"])
    assert not estimate.converged


def test_recordings_of_other_motions_have_one_inertia(rigid):
    """It is that of the description, wherever the arm moved."""
    other = {name: r.slice(0, 1000) for name, r in moving_arm.rigid(2.0, seed=5).items()}
    description = Description(URDF)
    moved = [
        description.load("turn", *(np.array([r["link_position"] for r in m.values()]).T,) * 3) for m in (rigid, other)
    ]
    means = [float(load.inertia.mean()) for load in moved]
    assert abs(means[0] - means[1]) > 0.02 * means[0]
    both = loaded(description, "turn", [rigid, other])
    for recording in both.recordings:
        estimate = fit(RIGID, recording)
        assert abs(estimate["J"].value - ROTOR[0] - both.inertia) < 4.0 * estimate["J"].std_dev


def test_the_inertia_that_models_keep_is_the_mean_over_poses():
    """Against the closed form of the textbook's arm, whose first joint carries b11 = a + 2 b cos(q2)."""
    description = Description(two_links())
    m, length, centre, inertia = TWO_LINKS
    b22 = inertia[1] + m[1] * centre[1] ** 2
    b11 = inertia[0] + m[0] * centre[0] ** 2 + m[1] * length**2 + b22  # where the cosine is zero in the mean
    np.testing.assert_allclose(typical_inertia(description), [b11, b22], rtol=2e-3)


def test_a_joint_that_slides_keeps_the_inertia_at_zero():
    more = link("slide", 2.0, (0.0, 0.0, 0.0), 0.01) + joint("rail", "plate", "slide", "", "1 0 0", "prismatic")
    description = Description(URDF.replace("</robot>", f"{more}</robot>"))
    assert abs(typical_inertia(description)[-1] - 2.0) < 1e-9


@pytest.mark.parametrize("cut", first_quick([[*JOINTS], ["lift"], ["turn"]]))
def test_a_gap_of_any_joint_is_left_out(rigid, cut):
    keep = np.ones(len(rigid["lift"]), dtype=bool)
    keep[5000:5300] = False
    part = {}
    for name, whole in rigid.items():
        rows = keep if name in cut else np.ones_like(keep)
        part[name] = Recording(whole.time[rows], {n: v[rows] for n, v in whole.channels.items()}, joint=name)
    found = loaded(Description(URDF), "lift", [part])
    whole = loaded(Description(URDF), "lift", [rigid]).recordings[0]
    recording = found.recordings[0]
    there = np.isfinite(recording["external_torque"])
    assert 0 < np.count_nonzero(~there) < 450
    same = np.interp(recording.time[there], whole.time, whole["external_torque"])
    shift = found.inertia - loaded(Description(URDF), "lift", [rigid]).inertia
    assert np.abs(recording["external_torque"][there] - same).max() < 0.5 + 10.0 * abs(shift)
    estimate = fit(RIGID, recording)
    assert abs(estimate["c"].value - VISCOUS[1]) < 4.0 * estimate["c"].std_dev


def test_joints_may_be_sampled_at_other_instants_and_rates(rigid):
    """As in a bag with a topic for each joint; times count from other origins."""
    description, shifted = Description(URDF), dict(rigid)
    for k, name in enumerate(("turn", "bend", "roll")):
        r = rigid[name].slice(k, len(rigid[name]))
        rows = slice(None, None, k + 1)
        channels = {n: v[rows] for n, v in r.channels.items()}
        shifted[name] = Recording(r.time[rows] + 7.0, channels, joint=name, origin=-7)
    here, there = (loaded(description, "lift", [r]).recordings[0] for r in (rigid, shifted))
    load = np.interp(there.time, here.time, here["external_torque"])
    assert np.abs(there["external_torque"] - load).max() < 0.3


# --- bad input


BAD = {
    "not XML": (URDF[:200], "not XML"),
    "an MJCF": ('<mujoco model="a"/>', "its root is <mujoco>"),
    "a joint that floats": (URDF.replace('type="fixed"', 'type="floating"'), "'flange' is floating"),
    "a joint without a link": (URDF.replace('child link="tool"', 'child link="hook"'), "'hook', which is no link"),
    "no mass": (URDF.replace('<mass value="3.0"/>', '<mass value="0"/>'), "'fore', which joint bend moves, has mass 0"),
    "no inertial": (URDF.replace(link("fore", 3.0, (0.18, 0.01, 0.0), 0.02), '<link name="fore"/>'), "'fore'.*mass 0"),
    "grams": (URDF.replace('<mass value="', '<mass value="1000000'), "is in kg and m"),
    "no body": (URDF.replace('iyy="', 'iyy="-'), "an inertia that no body has"),
    "a xacro": ('<robot name="a" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>', "expand it first"),
    "nothing moves": ('<robot name="a"><link name="base"/></robot>', "no joint moves"),
    "a follower of none": (
        URDF.replace("</robot>", link("f", 1.0, (0, 0, 0), 0.1)
                     + joint("grip", "tool", "f", "", "0 0 1", more='<mimic joint="nobody"/>') + "</robot>"),
        "'grip' follows 'nobody'",
    ),
    "two roots": (URDF.replace("</robot>", '<link name="island"/></robot>'), "not a valid URDF"),
}  # fmt: skip


@pytest.mark.parametrize("text, told", BAD.values(), ids=BAD)
def test_a_wrong_description_is_refused(text, told):
    with pytest.raises(JointIdError, match=told) as error:
        Description(text, "robot.urdf")
    assert "robot.urdf" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("gravity", [(0, 0), (0, 0, -981), (0, 0, "down"), (0, 0, float("nan"))])
def test_a_gravity_that_is_none_is_refused(gravity):
    with pytest.raises(JointIdError, match="m/s"):
        Description(URDF, gravity=gravity)


def test_no_gravity_may_be_given():
    assert Description(URDF, gravity=(0.0, 0.0, 0.0)).joints == JOINTS


def _load(recordings: dict[str, Recording], name: str = "lift") -> Loaded:
    return loaded(Description(URDF, "robot.urdf"), name, [recordings])


def test_recordings_that_do_not_match_are_refused(rigid):
    five = {name: r for name, r in rigid.items() if name != "tilt"}
    with pytest.raises(JointIdError, match="no recording of tilt, which robot"):
        _load(five)
    renamed = {f"joint_{k}": r for k, r in enumerate(rigid.values())} | {"lift": rigid["lift"]}
    with pytest.raises(JointIdError, match="recorded: joint_0, joint_1"):
        _load(renamed)
    with pytest.raises(JointIdError, match=r"no 'lfit'.*did you mean lift"):
        _load(rigid, "lfit")
    own = rigid["lift"].with_channels({"external_torque": np.zeros(len(rigid["lift"]))})
    with pytest.raises(JointIdError, match="has an external_torque already"):
        _load({**rigid, "lift": own})
    motor = Recording(rigid["turn"].time, {"motor_position": rigid["turn"]["link_position"]}, source="bag")
    with pytest.raises(JointIdError, match="joint turn has no link_position"):
        _load({**rigid, "turn": motor})
    later = Recording(rigid["turn"].time + 1e3, dict(rigid["turn"].channels))
    with pytest.raises(JointIdError, match="not recorded at the same time"):
        _load({**rigid, "turn": later})
