"""The emulated robot with the links of a URDF: gravity, coupling, and what it carries."""

from __future__ import annotations

import re

import numpy as np
import pytest

from joint_id_core.errors import JointIdError

from . import moving_arm
from .moving_arm import URDF, joint, link

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.loaded import loaded
from joint_id_core.emulator.links import GRIP, RigidLinks
from joint_id_core.emulator.robots import HOME, build_joints
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from joint_id_core.results.verdict import Verdict

from .emulated_arm import ARM, AT_LINK, DRIVES, GAINS, RATIO, VALUES, built, recordings, run, values_of

CARRIED = 2.5
POINT = URDF.replace(
    "</robot>",
    link("load", CARRIED, (0.0, 0.0, 0.0), 1e-12)
    + joint("grip", "plate", "load", f'xyz="{" ".join(map(str, GRIP))}"', "1 0 0", "fixed")
    + "</robot>",
)
STILL = moving_arm.Motion(np.array([HOME]), np.zeros((1, 6)), np.zeros((1, 6)))


@pytest.fixture(scope="module")
def free():
    """Twelve seconds of motion without a payload."""
    return run(built(), 12.0)


@pytest.fixture(scope="module")
def carrying():
    """The same motion with one."""
    controller = built()
    controller.arm.carry(CARRIED)
    return run(controller, 12.0)


def test_links_and_payload_are_those_of_another_library():
    motion, links = moving_arm.at(np.linspace(0.0, 3.0, 20), seed=3), RigidLinks(ARM)
    for urdf, mass in ((URDF, 0.0), (POINT, CARRIED), (URDF, 0.0)):
        links.carry(mass)
        expected = moving_arm.inverse(motion, urdf)
        for k, (q, dq, ddq) in enumerate(zip(motion.q, motion.dq, motion.ddq, strict=True)):
            inertia, bias = links.dynamics(q, dq)
            np.testing.assert_allclose(inertia @ ddq + bias, expected[k], atol=1e-6)
            # The controller knows nothing of the payload.
            np.testing.assert_allclose(links.needed(q, dq, ddq), moving_arm.inverse(motion)[k], atol=1e-6)


def test_at_rest_the_currents_hold_the_arm_and_nothing_moves():
    shown = run(built(moving=()), 1.0)
    np.testing.assert_array_equal(shown["speed"], 0.0)
    gravity = moving_arm.inverse(STILL)[0]
    assert abs(gravity).max() > 15.0
    # The controllers see the noise of the sensors, 17 mA: 0.17 Nm at the link, in a second's mean 0.008.
    held = shown["current"] * VALUES["k_t"] * RATIO
    assert np.all(abs(held.mean(axis=0) - gravity) < 4 * held.std(axis=0) / np.sqrt(500) + 0.01)
    assert (shown["actual_current"] - shown["current"]).std() == pytest.approx(0.01, rel=0.1)
    # The gears are twisted by it.
    twist = (shown["motor"] / RATIO - shown["actual_q"]).mean(axis=0)
    torque = VALUES["k_1"] * twist + VALUES["k_2"] * twist**3
    np.testing.assert_allclose(torque, gravity, atol=0.2)


@pytest.mark.long
def test_the_links_follow_their_references_and_other_joints_are_felt(free):
    assert np.ptp(free["actual_q"], axis=0).min() > 0.6
    assert abs(free["actual_q"] - free["target_q"]).max() < 0.02
    # A joint that rests is pushed by the others.
    alone = run(built(moving=(1,)), 4.0)
    assert np.ptp(alone["current"][:, 2]) > 0.3 and np.ptp(alone["actual_q"][:, 2]) < 0.01


def test_power_and_stops_leave_the_arm_where_it_is():
    controller = built()
    before = run(controller, 1.0)
    controller.power(False)
    off = run(controller, 0.5)
    np.testing.assert_array_equal(off["actual_q"], np.tile(off["actual_q"][0], (250, 1)))
    np.testing.assert_array_equal(off["actual_current"], 0.0)
    np.testing.assert_array_equal(controller.values["target_moment"], 0.0)
    controller.power(True)
    on = run(controller, 2.0)
    assert abs(on["actual_q"][:10] - off["actual_q"][-1]).max() < 5e-4
    assert abs(on["actual_q"] - on["target_q"]).max() < 0.02
    assert abs(on["current"]).max() < 1.5 * abs(before["current"]).max() + 1.0
    controller.protective_stop(True)
    held = run(controller, 1.0)
    # Rotors that friction just holds are shaken by the noise that their controllers see, and give way a little.
    places = held["actual_q"][300:].reshape(4, 50, 6).mean(axis=1)
    assert np.ptp(places, axis=0).max() < 1e-4 and abs(held["speed"][300:]).max() < 2e-3
    assert abs(held["current"][-1, 1]) > 0.5  # the shoulder holds the arm


def test_a_payload_can_be_picked_up_and_put_down_while_it_moves():
    controller = built(moving=())
    empty = run(controller, 0.5)
    controller.arm.carry(CARRIED)
    run(controller, 1.0)
    full = run(controller, 0.2)
    more = (full["current"] - empty["current"][-1]).mean(axis=0) * VALUES["k_t"] * RATIO
    expected = moving_arm.inverse(STILL, POINT)[0] - moving_arm.inverse(STILL)[0]
    # Friction may hold a part of it, and in the new pose gravity is a little different.
    assert np.all(abs(more - expected) <= AT_LINK[:, 2] + 0.1) and abs(more).max() > 3.0
    assert 1e-3 < abs(full["actual_q"] - empty["actual_q"][-1]).max() < 0.05
    controller.arm.carry(0.0)
    run(controller, 1.0)
    assert abs(run(controller, 0.2)["current"] - empty["current"][-1]).max() < AT_LINK[1, 2]


# --- what is found of it


@pytest.mark.long
def test_friction_and_rotors_of_the_arm_are_found(free):
    found = fit_arm(ARM, [recordings(free)], GAINS)
    assert found.converged
    values, sigma = values_of(found)
    assert np.sqrt(np.mean(((values - AT_LINK) / sigma) ** 2)) < 2.5
    np.testing.assert_allclose(values[:, 2], AT_LINK[:, 2], rtol=0.03)
    np.testing.assert_allclose(values[:, 1], AT_LINK[:, 1], rtol=0.06)
    np.testing.assert_allclose(values[1:, 0], AT_LINK[1:, 0], rtol=0.15)  # that of the first one has a wide interval


@pytest.mark.long
def test_the_payload_is_weighed(free, carrying):
    load = fit_arm(ARM, [recordings(free)], GAINS, payload=[recordings(carrying)]).payload
    assert load is not None and load.link == "plate" and load.known
    assert abs(load.mass - CARRIED) < 4.0 * load.mass_std_dev < 0.1 * CARRIED
    for value, sigma, truth in zip(load.centre, load.centre_std_dev, GRIP, strict=True):
        assert abs(value - truth) < 4.0 * sigma < 0.02


@pytest.mark.long
@pytest.mark.parametrize("name", ["lift", "bend"])
def test_gear_and_friction_of_a_joint_are_found_beneath_the_load_of_the_arm(free, name):
    truth = DRIVES[ARM.joints.index(name)].values
    record = loaded(ARM, name, [recordings(free)]).recordings[0]
    estimate = fit(build("harmonic_drive", actuation="current"), record, ParameterSettings({"k_t": truth["k_t"]}))
    assert estimate.converged, estimate.message
    for part, share in (("k_1", 0.05), ("tau_fm", 0.05), ("tau_fq", 0.05), ("c_m", 0.25), ("c_q", 0.25), ("J_m", 0.25)):
        assert estimate[part].verdict is Verdict.ESTIMATED
        assert abs(estimate[part].value - truth[part]) < share * truth[part], part


# --- what cannot be


SEVENTH = URDF.replace('name="flange" type="fixed"', 'name="flange" type="revolute"')
SLIDING = URDF.replace('name="bend" type="revolute"', 'name="bend" type="prismatic"')
BRANCH = URDF.replace('<parent link="hand"/><child link="plate"/>', '<parent link="fore"/><child link="plate"/>')
FOLLOWING = SEVENTH.replace('<child link="tool"/>', '<child link="tool"/><mimic joint="spin"/>')


@pytest.mark.parametrize(
    ("urdf", "told"),
    [
        (SEVENTH, "7 joints move (turn, lift, bend, roll, tilt, spin, flange), those of the emulated robot are 6"),
        (SLIDING, "joint bend does not turn"),
        (BRANCH, "does not follow"),
        (FOLLOWING, "flange follows another joint (mimic): make it fixed"),
    ],
)
def test_arms_that_the_robot_cannot_have_are_refused(urdf, told):
    with pytest.raises(JointIdError, match=re.escape(told)):
        RigidLinks(Description(urdf, "other.urdf"))


def test_an_arm_or_a_payload_that_the_drives_cannot_hold_is_refused():
    with pytest.raises(JointIdError, match=r"lift would need .* Nm against gravity .* take a larger --robot, or less"):
        built(urdf=Description(URDF.replace('mass value="3.0"', 'mass value="300.0"'), "heavy.urdf"))
    controller = built(moving=())
    with pytest.raises(JointIdError, match="would need"):
        controller.arm.carry(100.0)
    run(controller, 0.1)
    np.testing.assert_array_equal(controller.arm.joints.link_velocity, 0.0)  # it carries what it carried
    from joint_id_core.emulator.controller import Controller

    with pytest.raises(JointIdError, match="start it with --urdf"):
        Controller(build_joints("ur3e"), (), 0.0, (5, 13, 0)).arm.carry(1.0)
