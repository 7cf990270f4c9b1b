"""Friction of an arm beyond viscous and Coulomb friction, how far it drifts, and joints that rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.results.verdict import Verdict

from . import moving_arm
from .moving_arm import CARRYING, COULOMB, JOINTS, MASS, URDF, VISCOUS
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.drift import STRETCH, drift
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.friction import AT_REST, FASTEST, SLOPE, Friction, bend, usual_load
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import Stacked

ARM = Description(URDF, "arm.urdf")
GAINS = {name: {"torque": 1.0} for name in JOINTS}
GROWTH, FALLS = 0.06, np.array([3.0, 0.0, 1.5, 0.0, -0.8, 0.0])
SLOW = 0.05  # share of the motion, at most 0.2 rad/s


@pytest.fixture(scope="module")
def bent() -> ArmEstimate:
    """A fit of recordings with friction that grows with the load, and bends in three joints."""
    records = [moving_arm.rigid(25.0, seed, growth=GROWTH, falls=FALLS) for seed in (0, 1)]
    return fit_arm(ARM, records, GAINS, moving_arm.rigid(10.0, 7, growth=GROWTH, falls=FALLS))


def test_friction_that_grows_with_the_load_is_found(bent):
    assert bent.by_load.verdict is Verdict.ESTIMATED
    assert abs(bent.by_load.value - GROWTH) < 4.0 * bent.by_load.std_dev < 0.15 * GROWTH
    assert "friction grows with the load, by 0.06" in str(bent)
    usual = usual_load(Regressor(ARM))
    assert [j.load for j in bent.joints] == usual.tolist()
    assert usual[0] == 0.0 and usual[1] > 20.0  # the first axis is vertical


def test_friction_that_bends_is_found_and_damping_and_friction_are_the_nearest_line(bent):
    usual = usual_load(Regressor(ARM))
    for j, found in enumerate(bent.joints):
        assert (found.bend == 0.0) == (FALLS[j] == 0.0)
        assert abs(found.bend - FALLS[j]) < 0.1 + 0.1 * abs(FALLS[j])
        speeds = np.linspace(0.0, FASTEST, 101)
        curve = VISCOUS[j] * speeds + COULOMB[j] + GROWTH * usual[j] + FALLS[j] * np.exp(-speeds / 0.3)
        slope, start = np.polyfit(speeds, curve, 1)
        assert abs(found.damping.value - slope) < 4.0 * found.damping.std_dev < 0.2 * slope
        assert abs(found.friction.value - start) < 4.0 * found.friction.std_dev < 0.1 * start


def test_such_friction_is_predicted_by_its_law_only(bent):
    assert min(j.held_out for j in bent.joints) > 0.9985


@pytest.mark.long
@pytest.mark.parametrize("falls", first_quick([0.0, 3.0]), ids=["straight", "bent"])
def test_a_motion_too_slow_to_tell_a_bend_from_a_line_has_both_in_its_intervals(falls):
    """Friction that turns sharply was taken for a bend: 0.46 +- 0.10 Nm in place of 1 Nm below 0.2 rad/s."""
    found = fit_arm(ARM, [moving_arm.rigid(40.0, 2, falls=falls, share=SLOW)], GAINS)
    assert found.converged and any("never faster than 0.6 rad/s" in doubt for doubt in found.doubts)
    for j, viscous, coulomb in zip(found.joints, VISCOUS + falls * SLOPE, COULOMB + falls * AT_REST, strict=True):
        assert j.bend == 0.0
        for value, true in ((j.damping, viscous), (j.friction, coulomb)):
            assert value.verdict is not Verdict.ESTIMATED or abs(value.value - true) < 4.0 * value.std_dev, (j, true)


def test_terms_that_the_data_do_not_ask_for_are_left_out():
    found = fit_arm(ARM, [moving_arm.rigid(15.0, 0)], GAINS)
    assert found.by_load.verdict is Verdict.PRIOR and "law of friction is without it" in found.by_load.reason
    assert found.by_load.value < 3.0 * found.by_load.std_dev < 0.01
    assert [j.bend for j in found.joints] == [0.0] * 6


def test_the_bend_is_what_a_stribeck_curve_has_beside_a_line():
    speed = np.linspace(0.05, FASTEST, 50)
    np.testing.assert_allclose(bend(speed) + AT_REST + SLOPE * speed, np.exp(-speed / 0.3), atol=1e-3)
    np.testing.assert_allclose(bend(-speed), -bend(speed))
    assert bend(np.zeros(1)) == 0.0


@pytest.mark.long
def test_torque_constants_come_out_right_with_friction_that_grows_with_the_load():
    wrong = np.array([1.25, 0.8, 1.1, 0.9, 1.3, 0.7])
    assumed = {name: {"torque": float(w)} for name, w in zip(JOINTS, wrong, strict=True)}
    free, carrying = (
        [moving_arm.rigid(15.0, seed, urdf, growth=GROWTH) for seed in seeds]
        for urdf, seeds in ((URDF, (0, 1)), (CARRYING, (2, 3)))
    )
    found = fit_arm(ARM, free, assumed, payload=carrying, mass=MASS)
    for factor, w in zip(found.factors, wrong, strict=True):
        assert abs(factor.value * w - 1.0) < min(0.02, 4.5 * factor.std_dev * w)
    assert abs(found.by_load.value - GROWTH) < 4.5 * found.by_load.std_dev


# --- drift


def table(change: float, seed: int, stretches: int = 4, count: int = 6) -> tuple[Stacked, np.ndarray, np.ndarray]:
    """Equations of two recordings whose damping and friction change from stretch to stretch; places and values."""
    rng, rows = np.random.default_rng(seed), stretches * STRETCH
    ys, columns, joint, pieces = [], [], [], []
    values = np.array([[4.0] * count, [3.0] * count])
    for piece in range(2 * count):
        j, speed = piece % count, np.sin(np.arange(rows) * 0.3 + rng.uniform(0.0, 6.0)) * rng.uniform(0.5, 1.0, rows)
        own = np.zeros((rows, 2 * count))
        own[:, j], own[:, count + j] = speed, np.tanh(speed / 0.01)
        factors = np.repeat(1.0 + change * rng.standard_normal((2, stretches)), STRETCH, axis=1)
        ys.append(own[:, j] * values[0, j] * factors[0] + own[:, count + j] * values[1, j] * factors[1])
        columns.append(own)
        joint.append(np.full(rows, j))
        pieces.append(np.full(rows, piece))
    y = np.concatenate(ys) + 0.2 * rng.standard_normal(len(ys) * rows)
    found = Stacked(y, np.concatenate(columns), np.concatenate(joint), np.concatenate(pieces), count)
    return found, np.arange(2 * count).reshape(2, count), values


@pytest.mark.parametrize("change", [0.0, 0.03, 0.1])
def test_drift_is_found_as_far_as_it_is_there(change):
    found = []
    for seed in range(4):
        some, places, values = table(change, seed)
        solution, _ = some.weighed()
        found.append(drift(some, some.y - some.columns @ solution, places, values, 5.0))
    mean = np.sqrt(np.mean(np.square(found), axis=0))
    assert np.all(np.abs(mean - change) < 0.006 + 0.25 * change)


@pytest.mark.long
def test_friction_that_drifts_has_wider_intervals():
    steady, changing = (fit_arm(ARM, [drifting(moving_arm.rigid(40.0, 2), change)], GAINS) for change in (0.0, 0.08))
    wider = [b.friction.std_dev / a.friction.std_dev for a, b in zip(steady.joints, changing.joints, strict=True)]
    assert min(wider) > 3.0


def drifting(record: dict, change: float) -> dict:
    """The same with Coulomb friction that wanders with the time."""
    moved = {}
    for j, (name, own) in enumerate(record.items()):
        speed = moving_arm.at(own.time + 0.5 / moving_arm.RATE, 2).dq[:, j]
        share = change * np.sin(2.0 * np.pi * own.time / 40.0 + j)
        moved[name] = own.with_channels({"torque": own["torque"] + share * COULOMB[j] * np.sign(speed)})
    return moved


# --- rest


@pytest.mark.long
def test_joints_at_rest_are_within_the_band_and_in_motion_predicted():
    found = fit_arm(
        ARM, [moving_arm.point_to_point(8, seed) for seed in (0, 1)], GAINS, moving_arm.point_to_point(6, 5)
    )
    assert min(j.held_out for j in found.joints) > 0.99
    assert np.mean([j.rest.held for j in found.joints]) > 0.95 and min(j.rest.held for j in found.joints) > 0.9
    for j, coulomb in zip(found.joints, COULOMB, strict=True):
        assert 0.2 < j.rest.resting < 0.8 and j.rest.recorded > 5.0
        assert 0.9 * coulomb < j.rest.band < 1.3 * coulomb
    assert "rests in band" in str(found) and f"± {found.joints[0].rest.band:.3g}" in str(found)


def test_without_rests_the_band_is_friction_at_standstill_and_this_is_said():
    found = fit_arm(ARM, [moving_arm.rigid(15.0, 0)], GAINS, moving_arm.point_to_point(4, 5))
    assert "no rest was recorded of turn, lift" in str(found)
    for j, coulomb in zip(found.joints, COULOMB, strict=True):
        assert j.rest.recorded == 0.0 and abs(j.rest.band - coulomb) < 0.05 * coulomb
        assert j.rest.held > 0.85


@pytest.mark.long
def test_a_rest_that_another_torque_holds_is_out_of_the_band():
    pushed = moving_arm.point_to_point(4, 5)
    lift = pushed["lift"]
    pushed["lift"] = replace(lift.with_channels({"torque": lift["torque"] + 15.0 * (lift.time > 0.6 * lift.time[-1])}))
    found = fit_arm(ARM, [moving_arm.point_to_point(8, 0)], GAINS, pushed)
    by_name = {j.name: j.rest.held for j in found.joints}
    assert by_name["lift"] < 0.7 < by_name["turn"]


def test_what_sticks_holds_no_less_with_a_small_load_and_more_with_a_large_one():
    law = Friction(np.zeros(0), np.array([50.0, 0.0]))
    # damping, Coulomb friction, bends, gears that yield, growth
    values = np.array([4.0, 4.0, 10.0, 3.0, 0.0, 2.0, *4 * [9.0], 0.06])
    held = law.breakaway(values, np.array([[0.0, 0.0], [50.0, 0.0], [150.0, 100.0]]))
    still = 3.0 + 2.0 * (1.0 - AT_REST)
    np.testing.assert_allclose(held, [[10.0, still], [10.0, still], [16.0, still + 6.0]])
