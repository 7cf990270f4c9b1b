"""Faults of an arm's recordings that the fit names, and counts in its intervals."""

from __future__ import annotations

import re

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.results.status import Status

from . import moving_arm
from .moving_arm import CARRYING, COULOMB, JOINTS, MASS, ROTOR, URDF, VISCOUS
from .quick import first_quick

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.regressor import Regressor

ARM = Description(URDF, "arm.urdf")
GAINS = {name: {"torque": 1.0} for name in JOINTS}
SECONDS = 20.0
FIVE_DEGREES = np.radians(5.0)


def holds(found: ArmEstimate) -> None:
    """Check that intervals of friction and rotors hold the truth."""
    for j, *truth in zip(found.joints, ROTOR, VISCOUS, COULOMB, strict=True):
        for value, true in zip((j.armature, j.damping, j.friction), truth, strict=True):
            if value.verdict.value == "estimated":
                assert abs(value.value - true) < 4.0 * value.std_dev, (j.name, value, true)


def amount(found: ArmEstimate, pattern: str) -> float:
    """Return the amount of the fault that is told."""
    told = [m for m in (re.search(pattern, doubt) for doubt in found.doubts) if m]
    assert len(told) == 1, found.doubts
    return float(told[0].group(1))


def with_zero_off(joint: str, angle: float, seconds: float = 40.0) -> dict[str, Recording]:
    """Return a recording whose encoder of a joint shows too much by an angle in rad."""
    record = moving_arm.rigid(seconds, 4)
    shown = {"link_position": record[joint]["link_position"] + angle}
    return {**record, joint: record[joint].with_channels(shown)}


def test_nothing_is_told_of_recordings_without_a_fault():
    for seed in (1, 4):
        found = fit_arm(ARM, [moving_arm.rigid(SECONDS, seed), moving_arm.rigid(SECONDS, seed + 1)], GAINS)
        assert found.converged and not found.doubts, found.doubts


@pytest.mark.parametrize(("late", "seed"), first_quick([(0.002, 2), (0.008, 1)]), ids=["2 ms", "8 ms"])
def test_torques_that_come_late_are_named(late, seed):
    found = fit_arm(ARM, [moving_arm.rigid(SECONDS, seed, late=late)], GAINS)
    assert amount(found, r"torques seem to be ([\d.]+) ms late") == pytest.approx(1e3 * late, rel=0.15)
    holds(found)


def test_a_base_that_leans_is_named():
    tilted = 9.81 * np.array([np.sin(FIVE_DEGREES), 0.0, -np.cos(FIVE_DEGREES)])
    found = fit_arm(ARM, [moving_arm.rigid(SECONDS, 1, gravity=tuple(tilted))], GAINS)
    assert abs(amount(found, r"turned by (-?[\d.]+) degrees about y of the base")) == pytest.approx(5.0, rel=0.3)
    holds(found)


@pytest.mark.parametrize(
    ("name", "stiffness", "seconds"), first_quick([("bend", 3.0, SECONDS), ("lift", 10.0, 3.0 * SECONDS)])
)
def test_a_spring_at_a_joint_is_named(name, stiffness, seconds):
    """Gravity pulls at the lift nearly as a spring does: the mass and its place explain all but 0.03 % of one."""
    record = moving_arm.rigid(seconds, 2)
    own = record[name]
    pulled = {**record, name: own.with_channels({"torque": own["torque"] + stiffness * own["link_position"]})}
    found = fit_arm(ARM, [pulled], GAINS)
    assert amount(found, rf"pulls at {name} as a spring of (-?[\d.]+) Nm/rad") == pytest.approx(stiffness, rel=0.4)
    holds(found)


@pytest.mark.long
def test_what_pushes_from_the_middle_is_no_spring():
    """Intervals contain it, whatever it is."""
    record = moving_arm.rigid(SECONDS, 2)
    own = record["bend"]
    pushed = {**record, "bend": own.with_channels({"torque": own["torque"] - 3.0 * own["link_position"]})}
    found = fit_arm(ARM, [pushed], GAINS)
    assert not any("spring" in doubt for doubt in found.doubts), found.doubts
    holds(found)


@pytest.mark.parametrize("joint", first_quick(["lift", "bend", "roll"]))
def test_a_wrong_zero_is_that_of_its_joint(joint):
    """It changes inertias, too, and not gravity alone: for that it was taken for a zero elsewhere, or a spring."""
    found = fit_arm(ARM, [with_zero_off(joint, 0.05)], GAINS)
    assert amount(found, rf"zero of {joint} seems to be off by ([\d.]+) degrees") == pytest.approx(2.86, rel=0.1)
    holds(found)


@pytest.mark.long
def test_a_zero_that_is_off_as_those_of_robots_are_is_in_the_intervals():
    """What links seem to be goes with it, though nothing shows it: 1 mrad was 5 to 10 standard deviations."""
    regressor, record = Regressor(ARM), with_zero_off("bend", 1e-3)
    found = fit_arm(ARM, [record], GAINS)
    assert not found.doubts
    true = regressor.reference + regressor.composition[:, : len(JOINTS)] @ ROTOR
    for parameter, value in zip(found.parameters, true, strict=True):
        if parameter.verdict.value == "estimated":
            assert abs(parameter.value - value) < 4.0 * parameter.std_dev, parameter


def test_a_load_that_nobody_told_of_is_named():
    """In one of two recordings, and from the middle of one on."""
    free, carrying = moving_arm.rigid(SECONDS, 1), moving_arm.rigid(SECONDS, 2, CARRYING)
    found = fit_arm(ARM, [free, carrying], GAINS)
    assert amount(found, r"about ([\d.]+) kg more in recording 2 than in the others") == pytest.approx(MASS, rel=0.6)
    holds(found)
    other = moving_arm.rigid(SECONDS, 1, CARRYING)
    later = free["bend"].time > 0.5 * SECONDS
    midway = {n: r.with_channels({"torque": np.where(later, other[n]["torque"], r["torque"])}) for n, r in free.items()}
    found = fit_arm(ARM, [midway], GAINS)
    assert amount(found, r"seems to change meanwhile, by about ([\d.]+) kg") == pytest.approx(MASS, rel=0.6)
    holds(found)


@pytest.mark.long
def test_payloads_that_differ_are_no_payload():
    """Recordings with it, one of which has half of it."""
    half = CARRYING.replace(f'mass value="{MASS}"', f'mass value="{MASS / 2}"')
    assert half != CARRYING
    records = [moving_arm.rigid(SECONDS, k, urdf) for k, urdf in ((1, URDF), (2, CARRYING), (3, half))]
    found = fit_arm(ARM, records[:1], GAINS, payload=records[1:])
    amount(found, r"the payload seems to have about ([\d.]+) kg less in recording 3")
    assert found.payload is not None and abs(found.payload.mass - MASS) < 3.0 * found.payload.mass_std_dev


@pytest.mark.long
def test_an_axis_that_points_the_other_way_is_no_good_fit():
    record = moving_arm.rigid(SECONDS, 1)
    turned = {channel: -record["bend"][channel] for channel in ("link_position", "torque")}
    found = fit_arm(ARM, [{**record, "bend": record["bend"].with_channels(turned)}], GAINS)
    assert found.status is Status.POOR_FIT and "the other way" in found.message


@pytest.mark.long
def test_a_load_may_be_friction_of_gears_that_lose_more_when_they_drive():
    """Then nothing tells how large the masses are by more than that."""
    growth = 0.08
    records = [moving_arm.rigid(SECONDS, k, urdf, growth=growth) for k, urdf in ((1, URDF), (2, CARRYING))]
    found = fit_arm(ARM, records[:1], GAINS, payload=records[1:])
    assert found.payload is not None
    assert 0.3 * growth < found.payload.mass_std_dev / found.payload.mass < 0.7 * growth
    weighed = fit_arm(ARM, records[:1], GAINS, payload=records[1:], mass=MASS)
    assert all(factor.std_dev > 0.3 * growth * factor.value for factor in weighed.factors)
