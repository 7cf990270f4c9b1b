"""A fit of a whole arm: friction, rotors and base parameters of six joints that all move."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.results.verdict import Verdict

from . import moving_arm
from .moving_arm import CARRYING, CENTRE, COULOMB, JOINTS, MASS, ROTOR, URDF, VISCOUS
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.regressor import Regressor

ARM = Description(URDF, "arm.urdf")
GAINS = {name: {"torque": 1.0} for name in JOINTS}
SECONDS = 15.0


def fitted(*seeds: int) -> ArmEstimate:
    return fit_arm(ARM, [moving_arm.rigid(SECONDS, seed) for seed in seeds], GAINS)


def off(found: ArmEstimate) -> np.ndarray:
    """Errors of rotors and friction of all joints over their standard deviations."""
    rows = zip(found.joints, ROTOR, VISCOUS, COULOMB, strict=True)
    values = [(v, t) for j, *truth in rows for v, t in zip((j.armature, j.damping, j.friction), truth, strict=True)]
    return np.array([(v.value - truth) / v.std_dev for v, truth in values])


def test_base_parameters_give_the_torques_of_another_library():
    regressor = Regressor(ARM)
    motion = moving_arm.Motion(*np.random.default_rng(4).uniform(-2.0, 2.0, (3, 30, len(JOINTS))))
    torques = regressor.rows(motion.q, motion.dq, motion.ddq)[0] @ regressor.reference
    np.testing.assert_allclose(torques, moving_arm.inverse(motion), rtol=1e-9, atol=1e-9)
    # Six rotors, 6 x 10 inertial parameters: 40 combinations, as for other arms of this kind (Gautier & Khalil 1990).
    assert len(regressor.reference) == len(regressor.combinations) == 40
    assert regressor.combinations[0].startswith("rotor of turn +1 Izz of turn ")
    assert not regressor.alone[0] and regressor.combinations[2] == "rotor of bend"


def test_an_arm_of_one_joint_is_an_arm():
    one = moving_arm.link("column", 8.0, (0.1, 0.02, 0.0), 0.03)
    one += moving_arm.joint("turn", "base", "column", 'xyz="0 0 0.2"', "0 0 1", "continuous")
    regressor = Regressor(Description(f'<robot name="one"><link name="base"/>{one}</robot>', "one.urdf"))
    rows, _ = regressor.rows(*np.ones((3, 4, 1)))
    np.testing.assert_allclose(rows, 1.0)  # rotor and link turn as one
    assert len(regressor.reference) == 1 and not regressor.alone[0]


def test_a_column_that_only_rounding_makes_is_no_parameter():
    """The axes of two joints that meet at a right angle, which pi/2 is not to the last bit."""
    links = moving_arm.link("column", 3.0, (0.0, 0.0, 0.0), 0.02) + moving_arm.link("upper", 2.0, (0.2, 0.0, 0.1), 0.02)
    turned = f'xyz="0 0 0" rpy="{np.pi / 2:.17g} 0 0"'
    links += moving_arm.joint("turn", "base", "column", 'xyz="0 0 0.15"', "0 0 1", "continuous")
    links += moving_arm.joint("lift", "column", "upper", turned, "0 0 1", "continuous")
    regressor = Regressor(Description(f'<robot name="two"><link name="base"/>{links}</robot>', "two.urdf"))
    rows, _ = regressor.rows(*np.random.default_rng(0).uniform(-2.0, 2.0, (3, 50, 2)))
    assert np.linalg.norm(rows, axis=(0, 1)).min() > 1e-3


@pytest.mark.long
@pytest.mark.parametrize("name", first_quick(["lift", "roll", "spin"]))
def test_a_drive_with_the_other_sign_is_named(name):
    """It spoils the torques of joints before it, whose names alone would mislead; of the last one masses take it up."""
    motion = dict(moving_arm.rigid(SECONDS, 1))
    motion[name] = motion[name].with_channels({"torque": -motion[name]["torque"]})
    found = fit_arm(ARM, [motion], GAINS)
    assert not found.converged and f"the torque of {name} seems to have the other sign" in found.message


@pytest.mark.long
def test_friction_and_rotors_are_found_with_honest_intervals():
    z = np.array([off(fitted(seed)) for seed in range(10)])
    assert np.abs(z).max() < 4.5
    kinds = np.sqrt(np.mean(z.reshape(len(z), -1, 3) ** 2, axis=(0, 1)))  # rotors, viscous and Coulomb friction
    assert np.all(kinds > 0.8) and np.all(kinds < 1.3)
    assert 0.9 < np.mean(np.abs(z) < 1.96) < 0.98


def test_so_are_the_combinations_of_masses_and_inertias():
    found, regressor = fitted(0, 1), Regressor(ARM)
    truth = regressor.reference + np.concatenate([ROTOR, np.zeros(len(regressor.reference) - len(JOINTS))])
    known = [(p.value - t) / p.std_dev for p, t in zip(found.parameters, truth, strict=True)]
    assert np.abs(known).max() < 4.0
    assert sum(p.verdict is Verdict.ESTIMATED for p in found.parameters) > 25


def test_several_recordings_tell_more():
    one, three = fitted(0), fitted(0, 1, 2)
    ratios = [b.armature.std_dev / a.armature.std_dev for a, b in zip(one.joints, three.joints, strict=True)]
    assert np.median(ratios) < 0.85
    assert np.abs(off(three)).max() < 4.0


def test_another_motion_is_predicted():
    found = fit_arm(ARM, [moving_arm.rigid(SECONDS, 0)], GAINS, moving_arm.rigid(8.0, 9))
    assert found.converged
    assert min(j.held_out for j in found.joints) > 0.998
    assert "held out" in str(found)


def test_a_joint_that_rests_has_no_value():
    still = moving_arm.rigid(SECONDS, 0)
    record = still["spin"]
    noise = 1e-5 * np.random.default_rng(0).standard_normal(len(record))
    still["spin"] = Recording(record.time, {"link_position": noise, "torque": record["torque"]}, joint="spin")
    found = fit_arm(ARM, [still], GAINS)
    spin = found.joints[-1]
    assert spin.damping.verdict is spin.friction.verdict is Verdict.NOT_EXCITED
    assert not np.isfinite(spin.r_squared) and " - " in str(found)


@pytest.mark.long
def test_a_torque_that_is_another_quantity_is_a_poor_fit():
    wrong = moving_arm.rigid(SECONDS, 0)
    record = wrong["bend"]
    noise = 10.0 * np.random.default_rng(0).standard_normal(len(record)).cumsum() / np.sqrt(len(record))
    wrong["bend"] = record.with_channels({"torque": noise})
    found = fit_arm(ARM, [wrong], GAINS)
    assert not found.converged and "bend" in found.message


def test_samples_without_a_value_and_gaps_are_left_out():
    record, rng = moving_arm.rigid(SECONDS, 0), np.random.default_rng(1)
    keep = np.ones(len(record["lift"]), dtype=bool)
    keep[3000:3400] = False
    holes = {}
    for name, whole in record.items():
        torque = np.where(rng.random(len(whole)) < 0.01, np.nan, whole["torque"])
        rows = keep if name == "lift" else slice(None)
        holes[name] = Recording(
            whole.time[rows], {"link_position": whole["link_position"][rows], "torque": torque[rows]}, joint=name
        )
    found = fit_arm(ARM, [holes], GAINS)
    assert found.converged and np.abs(off(found)).max() < 5.0


def test_recordings_are_checked_first():
    record = moving_arm.rigid(SECONDS, 0)
    slow = {n: Recording(1e3 * r.time, dict(r.channels), source="log", joint=n) for n, r in record.items()}
    with pytest.raises(JointIdError, match=r"log: joint turn: .*milliseconds"):
        fit_arm(ARM, [slow], GAINS)
    degrees = {n: r.with_channels({"link_position": np.rad2deg(r["link_position"])}) for n, r in record.items()}
    with pytest.raises(JointIdError, match=r"joint turn: Channel link_position spans .* it is in degrees"):
        fit_arm(ARM, [degrees], GAINS)
    torque = record["lift"]["torque"].copy()
    torque[2000] = 5e3
    found = fit_arm(ARM, [{**record, "lift": record["lift"].with_channels({"torque": torque})}], GAINS)
    assert any("joint lift" in text for text in found.doubts) and "doubtful: " in str(found)


def test_what_cannot_be_fitted_is_refused():
    record = moving_arm.rigid(2.0)
    with pytest.raises(JointIdError, match="no recording of tilt, which arm"):
        fit_arm(ARM, [{n: r for n, r in record.items() if n != "tilt"}], GAINS)
    with pytest.raises(JointIdError, match=r"joint turn has a current: give its torque constant .*--set turn.k_t=0.1"):
        current = {
            n: Recording(r.time, {"link_position": r["link_position"], "current": r["torque"]})
            for n, r in record.items()
        }
        fit_arm(ARM, [current], GAINS)
    with pytest.raises(JointIdError, match="no torque and no current"):
        fit_arm(ARM, [{n: Recording(r.time, {"link_position": r["link_position"]}) for n, r in record.items()}], GAINS)
    with pytest.raises(JointIdError, match="too few for the 52 parameters"):
        fit_arm(ARM, [{n: r.slice(0, 450) for n, r in record.items()}], GAINS)
    rest = {n: r.with_channels({"link_position": np.zeros(len(r))}) for n, r in record.items()}
    with pytest.raises(JointIdError, match="no joint moves"):
        fit_arm(ARM, [rest], GAINS)


def test_doubts_are_about_what_is_used():
    record = moving_arm.rigid(SECONDS, 0)
    lift = record["lift"]
    speed = moving_arm.at(lift.time).dq[:, 1]
    speed[2000] = 500.0
    found = fit_arm(ARM, [{**record, "lift": lift.with_channels({"link_velocity": speed})}], GAINS)
    assert not found.doubts


@pytest.mark.long
def test_a_joint_that_moves_and_is_fixed_in_the_description_is_told():
    fixed = Description(URDF.replace('name="spin" type="continuous"', 'name="spin" type="fixed"'), "fixed.urdf")
    assert fixed.fixed == ("spin", "flange")
    record = moving_arm.rigid(SECONDS, 0)
    told = "arm: spin moves, and does not in fixed.urdf"
    assert any(told in text for text in fit_arm(fixed, [record], GAINS).doubts)
    still = record["spin"].with_channels({"link_position": np.full(len(record["spin"]), 0.3)})
    assert not fit_arm(fixed, [{**record, "spin": still}], GAINS).doubts


# --- a joint that stands


@pytest.mark.parametrize("standing", first_quick([(("bend",),), (("lift", "bend"),)]))
def test_a_joint_that_stands_leaves_the_others_right(standing):
    """Its encoder has noise, and the torques of neighbours with parallel axes go together."""
    record = moving_arm.rigid(SECONDS, 1, standing=standing, noise=1e-4)
    found = fit_arm(ARM, [record], GAINS)
    assert found.converged and f"{', '.join(standing)} did not move" in found.message
    for j, truth in zip(found.joints, zip(ROTOR, VISCOUS, COULOMB, strict=True), strict=True):
        for value, true in zip((j.armature, j.damping, j.friction), truth, strict=True):
            if j.name in standing:
                assert value.verdict is Verdict.NOT_EXCITED
            elif value.verdict is Verdict.ESTIMATED:
                assert abs(value.value - true) < 4.0 * value.std_dev, (j.name, value, true)
    assert sum(j.damping.verdict is Verdict.ESTIMATED for j in found.joints) == len(JOINTS) - len(standing)
    for link in found.links.links:
        assert 0.5 < link.found.mass / link.described.mass < 2.0
    for p in found.parameters:
        assert p.verdict is not Verdict.ESTIMATED or p.std_dev > 0.0


def test_a_motion_of_one_joint_tells_of_no_other():
    standing = tuple(name for name in JOINTS if name != "roll")
    found = fit_arm(ARM, [moving_arm.rigid(SECONDS, 1, standing=standing)], GAINS)
    assert found.converged and all(np.isfinite(p.value) and np.isfinite(p.std_dev) for p in found.parameters)
    roll = found.joints[JOINTS.index("roll")]
    for value, truth in ((roll.damping, VISCOUS[3]), (roll.friction, COULOMB[3])):
        assert value.verdict is Verdict.ESTIMATED and abs(value.value - truth) < 4.0 * value.std_dev
    assert roll.armature.verdict is not Verdict.ESTIMATED or abs(roll.armature.value - ROTOR[3]) < (
        4.0 * roll.armature.std_dev
    )
    assert not found.by_load.value > 0.5  # of a joint that hardly bears a load


@pytest.mark.long
def test_what_it_does_not_show_is_not_predicted():
    """What moves later is not known; the fit does not say otherwise."""
    found = fit_arm(ARM, [moving_arm.rigid(SECONDS, 1)], GAINS, moving_arm.rigid(SECONDS, 2))
    assert found.converged and not found.missed
    heavy = fit_arm(ARM, [moving_arm.rigid(SECONDS, 1)], GAINS, moving_arm.rigid(SECONDS, 2, CARRYING))
    assert not heavy.converged and {"lift", "bend"} <= {*heavy.missed}
    assert "in the held-out recording is not predicted" in heavy.message


def test_a_joint_that_counts_as_fixed_at_0_is_there(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    fixed = Description.read(tmp_path / "arm.urdf", still=["bend"])
    record = moving_arm.rigid(4.0, 1, standing=("bend",))
    off_zero = {
        **record,
        "bend": record["bend"].with_channels({"link_position": record["bend"]["link_position"] + 1.4}),
    }
    with pytest.raises(JointIdError, match=r"joint bend is at 1.4, and with --still bend it counts as fixed at 0"):
        fit_arm(fixed, [off_zero], GAINS)
    fit_arm(fixed, [record], GAINS)


# --- a payload


def test_a_payload_is_weighed():
    free = [moving_arm.rigid(SECONDS, seed) for seed in (0, 1)]
    found = fit_arm(ARM, free, GAINS, payload=[moving_arm.rigid(SECONDS, 2, CARRYING)])
    load = found.payload
    assert load is not None and load.link == "plate" and load.known
    assert abs(load.mass - MASS) < 4.0 * load.mass_std_dev < 0.05 * MASS
    for value, sigma, truth in zip(load.centre, load.centre_std_dev, CENTRE, strict=True):
        assert abs(value - truth) < 4.0 * sigma < 0.02
    assert np.abs(off(found)).max() < 4.5
    assert "payload on plate: 2.5" in str(found)


@pytest.mark.long
def test_without_a_payload_there_is_none():
    found = fit_arm(ARM, [moving_arm.rigid(SECONDS, 0)], GAINS, payload=[moving_arm.rigid(SECONDS, 2)])
    assert found.payload is not None and abs(found.payload.mass) < 4.0 * found.payload.mass_std_dev
    assert "not known" in str(found.payload)


def test_a_mass_that_was_weighed_gives_the_torque_constants():
    wrong = np.array([1.25, 0.8, 1.1, 0.9, 1.3, 0.7])
    assumed = {name: {"torque": float(w)} for name, w in zip(JOINTS, wrong, strict=True)}
    free = [moving_arm.rigid(SECONDS, seed) for seed in (0, 1)]
    carrying = [moving_arm.rigid(SECONDS, seed, CARRYING) for seed in (2, 3)]
    found = fit_arm(ARM, free, assumed, payload=carrying, mass=MASS)
    for factor, w in zip(found.factors, wrong, strict=True):
        assert abs(factor.value * w - 1.0) < 4.0 * factor.std_dev * w, factor
        assert factor.std_dev * w < 0.1
    assert np.abs(off(found)).max() < 4.5  # friction and rotors are right, and no better known than the constants
    least = found.factors[1].std_dev / found.factors[1].value
    assert found.joints[1].damping.std_dev >= least * found.joints[1].damping.value


@pytest.mark.long
def test_the_torque_constant_of_a_joint_that_stands_is_not_known():
    records = [moving_arm.rigid(SECONDS, k, urdf, standing=("bend",)) for k, urdf in ((0, URDF), (2, CARRYING))]
    found = fit_arm(ARM, records[:1], GAINS, payload=records[1:], mass=MASS)
    assert [factor.joint for factor in found.factors if not factor.known] == ["bend"]
    assert "bend not known" in str(found) and "nan" not in str(found).replace("bend", "")[:200]
    lift = found.factors[1]
    assert abs(lift.value - 1.0) < 4.0 * lift.std_dev < 0.2


@pytest.mark.long
def test_combinations_are_no_better_known_than_the_torque_constants():
    free, carrying = moving_arm.rigid(SECONDS, 0), moving_arm.rigid(SECONDS, 2, CARRYING)
    found = fit_arm(ARM, [free], GAINS, payload=[carrying], mass=MASS)
    of_roll = found.factors[3].std_dev / found.factors[3].value
    assert found.parameters[3].text == "rotor of roll"
    assert found.parameters[3].std_dev >= of_roll * found.parameters[3].value


def test_what_tells_nothing_of_a_payload_is_refused():
    record = moving_arm.rigid(4.0)
    with pytest.raises(JointIdError, match="no recording without a payload"):
        fit_arm(ARM, [], GAINS, payload=[record])
    with pytest.raises(JointIdError, match="tells nothing without a recording"):
        fit_arm(ARM, [record], GAINS, mass=2.0)
    for mass in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(JointIdError, match="give its mass in kg, above 0"):
            fit_arm(ARM, [record], GAINS, payload=[record], mass=mass)
