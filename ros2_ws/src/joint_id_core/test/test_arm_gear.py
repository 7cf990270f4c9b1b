"""Gears of an arm that yield: their columns, what is known of them beforehand, and rotors behind soft gears."""

from __future__ import annotations

import numpy as np
import pytest

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, RATIO, ROTOR, URDF, VISCOUS

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm import gear
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import PAYLOAD, equations
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.friction import Friction
from joint_id_core.arm.learning import learned
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import Stacked
from joint_id_core.estimators.regression.covariance import sandwich

SOFT = 0.25  # of the stiffness of the arm of these tests: rotors swing on their gears at 7 to 12 Hz
ARM = Description(URDF, "arm.urdf")
GAINS = {name: {"torque": RATIO} for name in JOINTS}


def test_columns_are_the_rates_of_the_torque_through_the_gear():
    time, w = np.arange(400) / 100.0, np.array([3.0, 8.0])
    known = np.ones(400, dtype=bool)
    known[150:160] = False
    load = np.where(known[:, None], np.sin(w * time[:, None]), np.nan)
    found = gear.rates(load, known, 100.0)
    assert found.shape == (400, 2, 4) and np.isfinite(found[known]).all() and np.isnan(found[~known][:, 0, 0]).all()
    for j in range(2):
        np.testing.assert_allclose(found[5:140, j, j], -(w[j] ** 2) * load[5:140, j], atol=0.01 * w[j] ** 2)
        np.testing.assert_allclose(found[5:140, j, 2 + j], w[j] * np.cos(w[j] * time[5:140]), atol=0.01 * w[j])
        assert not found[known][:, j, [1 - j, 3 - j]].any()


def test_what_is_known_beforehand_makes_the_covariance_that_of_the_rule_of_bayes():
    columns = np.random.default_rng(0).standard_normal((30, 3)) * [1.0, 10.0, 0.01]
    columns[:, 1] = 10.0 * columns[:, 0] + 1e-7 * columns[:, 1]  # as of the neighbours of a joint that stands
    scale, precision = np.array([1.0, 10.0, 0.01]), np.diag([0.01, 0.02, 50.0])
    scaled = columns / scale
    bayes = np.linalg.inv(columns.T @ columns + precision)
    np.testing.assert_allclose(sandwich(scaled, scaled.T @ scaled, scale, precision), bayes, rtol=1e-6)


def test_half_of_what_a_yielding_gear_changes_is_in_the_covariance():
    rng = np.random.default_rng(1)
    mixed = [[1.0, 0.0, 0.6], [0.0, 1.0, -0.2], [0.0, 0.0, 1.0]]
    columns, one = rng.standard_normal((200, 3)) @ mixed, np.zeros(200, int)
    y = columns @ [2.0, 1.0, 0.5]
    whole, without = (
        Stacked(y, columns * mask, one, one, 1).weighed()[0] for mask in (np.ones(3), np.array([1.0, 1.0, 0.0]))
    )
    covariance = np.linalg.inv(columns.T @ columns)
    found = gear.with_yielding(whole, covariance, np.array([2])) - covariance
    np.testing.assert_allclose(np.sqrt(np.diag(found)), 0.5 * np.abs(whole - without), rtol=1e-6)


def test_a_motion_that_tells_nothing_of_gears_leaves_them_as_they_are_known_beforehand():
    """Of a joint that rests, in the belief with which an arm is followed, too."""
    still = moving_arm.rigid(15.0, 0)
    spin = still["spin"]
    still["spin"] = spin.with_channels({"link_position": np.zeros(len(spin)), "torque": spin["torque"]})
    regressor = Regressor(ARM)
    plain = equations(regressor, still, {name: {"torque": 1.0} for name in JOINTS}, "arm")
    belief = learned([Friction.from_values(regressor, np.append(regressor.reference, np.zeros(PAYLOAD))).added(plain)])
    place = belief.gears[[5, 11]]
    np.testing.assert_array_equal(belief.values[place], 0.0)
    np.testing.assert_allclose(np.diag(belief.covariance)[place], 1.0 / gear.precision(6)[[5, 11]])


@pytest.fixture(scope="module")
def soft() -> dict:
    """The arm of MuJoCo behind soft gears."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(moving_arm, "STIFFNESS", SOFT * moving_arm.STIFFNESS)
        return moving_arm.flexible(20.0)


@pytest.mark.long
def test_rotors_and_friction_behind_soft_gears_are_found_with_honest_intervals(soft):
    found = fit_arm(ARM, [soft], GAINS)
    rows = zip(found.joints, ROTOR, VISCOUS, COULOMB, strict=True)
    values = [(v, t) for j, *truth in rows for v, t in zip((j.armature, j.damping, j.friction), truth, strict=True)]
    z = np.array([(v.value - truth) / v.std_dev for v, truth in values])
    assert np.abs(z).max() < 4.0 and np.sqrt(np.mean(z**2)) < 1.4
    assert np.median([j.armature.std_dev / j.armature.value for j in found.joints]) < 0.02


@pytest.mark.long
def test_how_much_soft_gears_yield_is_found(soft):
    """Of the joints that bear the arm; of the wrists it is hardly known."""
    regressor = Regressor(ARM)
    plain = equations(regressor, soft, GAINS, "arm")
    belief = learned([Friction.from_values(regressor, np.append(regressor.reference, np.zeros(PAYLOAD))).added(plain)])
    truth = ROTOR / (SOFT * moving_arm.STIFFNESS)
    value, sigma = belief.values[belief.gears[:6]], np.sqrt(np.diag(belief.covariance)[belief.gears[:6]])
    assert np.all(np.abs(value - truth) < 4.0 * sigma + 0.1 * truth)
    assert np.all(np.abs(value[:3] / truth[:3] - 1.0) < 0.25)
