"""Motions designed for a whole arm: limits that hold by another library, and a promise that fits keep."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.signal import lfilter

from joint_id_core.data.recording import Array, Recording
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.limits import JointLimits, violations
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError
from joint_id_core.results.verdict import Verdict

from . import moving_arm
from .moving_arm import COULOMB, JOINTS, ROTOR, URDF, VISCOUS

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.regressor import Regressor
from joint_id_core.design.arm_design import ArmDesign, design_arm, foreseen
from joint_id_core.design.arm_information import ArmColumns, Chosen
from joint_id_core.design.arm_motion import Task, _Search
from joint_id_core.design.arm_prior import ArmPrior, of_fit, typical
from joint_id_core.design.floor import Floor

ARM = Description(URDF, "arm.urdf")
REGRESSOR = Regressor(ARM)
HOME = np.array([0.0, -1.2, 1.2, -1.0, -1.0, 0.0])
SECONDS, FLOOR = 10.0, 0.05
MEMORY_S = 0.05  # of the noise that is made, by a first-order autoregression ...
IN_BAND = 2.0 / np.pi * np.arctan(2.0 * np.pi * 8.0 * MEMORY_S)  # ... of which so much power is below 8 Hz
# The autoregression at 20 samples a second whose variances add up to the same at low frequencies.
_SUM = 2.0 * MEMORY_S / IN_BAND / 0.05
TOLD_S = float(-0.05 / np.log((_SUM - 1.0) / (_SUM + 1.0)))
LIMITS = JointLimits(
    JOINTS,
    np.full(6, -2.0),
    np.full(6, 2.0),
    np.array([2.0, 2.0, 2.5, 3.0, 3.0, 3.0]),
    np.array([4.0, 4.0, 4.0, 6.0, 6.0, 6.0]),
    np.full(6, 60.0),
    np.array([110.0, 80.0, 45.0, 12.0, 8.0, 5.0]),
)
PRIOR = ArmPrior(
    VISCOUS,
    COULOMB,
    np.zeros(6),
    ROTOR,
    0.0,
    np.array([0.5, 0.5, 0.3, 0.1, 0.1, 0.06]),
    np.full(6, TOLD_S),
    "told",
)


@pytest.fixture(scope="module")
def designed() -> ArmDesign:
    return design_arm(ARM, LIMITS, PRIOR, HOME, SECONDS, floor=FLOOR)


def between(motion: Trajectory, count: int = 8001) -> tuple[Array, Array, Array, Array]:
    """Position and derivatives by the interpolation of another library."""
    table = np.stack([motion.position, motion.velocity, motion.acceleration], axis=1)
    curve = BPoly.from_derivatives(motion.time, table)
    time = np.linspace(0.0, motion.duration, count)
    return tuple(curve.derivative(order)(time) if order else curve(time) for order in range(4))  # type: ignore[return-value]


def recorded(motion: Trajectory, seed: int) -> dict[str, Recording]:
    """What such an arm of MuJoCo shows, torques with a noise that has a memory."""
    still, rate = 0.5, moving_arm.RATE
    count = round((motion.duration + 2.0 * still) * rate)
    time = np.arange(count) / rate
    middle = motion.at(time + 0.5 / rate - still)
    links = moving_arm.inverse(moving_arm.Motion(middle.position, middle.velocity, middle.acceleration))
    torque = links + ROTOR * middle.acceleration + VISCOUS * middle.velocity + COULOMB * np.sign(middle.velocity)
    rng = np.random.default_rng(seed)
    forgets = np.exp(-1.0 / rate / MEMORY_S)
    white = rng.standard_normal((count + 1000, 6)) * np.sqrt(1.0 - forgets**2)
    noise = lfilter([1.0], [1.0, -forgets], white, axis=0)[1000:]
    torque = torque + noise * PRIOR.noise / np.sqrt(IN_BAND)
    q = motion.at(time - still).position + 1e-5 * rng.standard_normal((count, 6))
    return {
        name: Recording(time, {"link_position": q[:, j], "torque": torque[:, j]}, source="arm", joint=name)
        for j, name in enumerate(JOINTS)
    }


def multisine(seed: int = 0) -> Trajectory:
    """1 to 3 Hz from the same home under the same limits, as large as they allow."""
    rng, tones = np.random.default_rng(seed), np.arange(1.0, 3.01, 0.2)
    cosines, sines = rng.standard_normal((2, 6, len(tones))) / tones**2
    motion = FourierMotion(JOINTS, HOME, cosines, sines, tones, SECONDS, 1.0)
    state = motion.at(np.linspace(0.0, SECONDS, 5001))
    peaks = [np.abs(getattr(state, k)).max(axis=0) / getattr(LIMITS, k) for k in ("velocity", "acceleration", "jerk")]
    share = 0.98 / np.max([np.abs(state.position - HOME).max(axis=0), *peaks], axis=0)[:, None]
    return replace(motion, cosines=share * cosines, sines=share * sines).sampled(125.0)


def deviations(found: ArmDesign) -> Array:
    return np.array([row.std_dev for row in found.expected])


def task(chosen: np.ndarray, floor: Floor | None = None, criterion: str = "sigma") -> Task:
    columns = ArmColumns(REGRESSOR, PRIOR)
    size = None if criterion != "A" else np.linspace(1.0, 2.0, columns.count)
    return Task(columns, Chosen(chosen, criterion, size), LIMITS, PRIOR.possible(REGRESSOR), HOME, 6.0, 125.0, floor)


@pytest.mark.parametrize("criterion", ["sigma", "D", "A"])
@pytest.mark.parametrize("kinds", ["all", "friction"])
def test_the_gradient_is_that_of_the_cost(kinds: str, criterion: str) -> None:
    count = ArmColumns(REGRESSOR, PRIOR).count
    chosen = np.ones(count, dtype=bool) if kinds == "all" else np.arange(count) >= len(REGRESSOR.reference)
    search = _Search(task(chosen, Floor(ARM, 0.3), criterion))
    rng = np.random.default_rng(0)
    z, way = 0.6 * rng.standard_normal((2, search.size))
    _, gradient = search.cost(z, 100.0)
    step = 1e-5
    slope = (search.cost(z + step * way, 100.0)[0] - search.cost(z - step * way, 100.0)[0]) / (2.0 * step)
    assert gradient @ way == pytest.approx(slope, rel=1e-3)


@pytest.mark.long
def test_limits_hold_between_samples_by_other_libraries(designed: ArmDesign) -> None:
    q, dq, ddq, jerk = between(designed.trajectory)
    assert np.all(np.abs(q - HOME) <= 1.0) and np.all((q > LIMITS.lower) & (q < LIMITS.upper))
    for values, limit in ((dq, LIMITS.velocity), (ddq, LIMITS.acceleration), (jerk, LIMITS.jerk)):
        assert np.all(np.abs(values).max(axis=0) <= limit * (1.0 + 1e-6))
    torque = moving_arm.inverse(moving_arm.Motion(q, dq, ddq)) + ROTOR * ddq + VISCOUS * dq + COULOMB * np.sign(dq)
    assert np.all(np.abs(torque).max(axis=0) <= LIMITS.torque)
    assert np.allclose(q[[0, -1]], HOME, atol=1e-9) and np.abs(dq[[0, -1]]).max() < 1e-6


@pytest.mark.long
def test_no_link_goes_below_the_floor(designed: ArmDesign) -> None:
    import mujoco

    model = mujoco.MjModel.from_xml_string(URDF.replace('<robot name="arm">', moving_arm.MUJOCO))
    data, lowest = mujoco.MjData(model), np.inf
    for q in between(designed.trajectory, 501)[0]:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        lowest = min(lowest, float(data.xpos[1:, 2].min()))
    assert FLOOR <= lowest < FLOOR + 0.5


@pytest.mark.long
def test_fits_keep_the_promise(designed: ArmDesign) -> None:
    off = []
    truth = np.concatenate([REGRESSOR.reference, VISCOUS, COULOMB])
    truth[:6] += ROTOR
    for seed in range(12):
        found = fit_arm(ARM, [recorded(designed.trajectory, seed)], {name: {"torque": 1.0} for name in JOINTS})
        values = [p.value for p in found.parameters] + [j.damping.value for j in found.joints]
        off.append(np.array(values + [j.friction.value for j in found.joints]) - truth)
    rows = {(row.joint, row.name): row.std_dev for row in designed.expected}
    promised = [rows["", text] for text in REGRESSOR.combinations]
    promised += [rows[name, kind] for kind in ("damping", "friction") for name in JOINTS]
    assert 0.8 < np.sqrt(np.mean((np.array(off) / promised) ** 2)) < 1.25


def test_it_tells_more_than_a_multisine(designed: ArmDesign) -> None:
    other = foreseen(REGRESSOR, multisine(), PRIOR)
    gain = deviations(other) / deviations(designed)
    assert np.exp(np.mean(np.log(gain))) > 2.0
    known = [sum(row.verdict is Verdict.ESTIMATED for row in found.expected) for found in (other, designed)]
    assert known[1] > known[0] + 8 and designed.condition < other.condition


def test_what_is_chosen_counts_and_all_else_is_in_the_way(designed: ArmDesign) -> None:
    columns, motion = ArmColumns(REGRESSOR, PRIOR), designed.trajectory
    information, _ = columns.information(columns.at(motion.position, motion.velocity, motion.acceleration))
    mask = np.zeros(columns.count, dtype=bool)
    mask[len(REGRESSOR.reference) : -1] = True
    variances = np.diag(np.linalg.inv(information))[mask]
    assert Chosen(mask).told(information)[0] == pytest.approx(-np.log(variances).sum(), abs=1e-2)
    block = np.linalg.inv(information)[np.ix_(mask, mask)]
    volume, mean = np.linalg.slogdet(block)[1], np.log(np.mean(variances))
    assert Chosen(mask, "D").told(information)[0] == pytest.approx(-volume, abs=1e-2)
    assert Chosen(mask, "A").told(information)[0] == pytest.approx(-len(variances) * mean, abs=1e-2)
    twice = Chosen(mask, "A", 2.0 * np.ones(columns.count)).told(information)[0]
    assert twice == pytest.approx(-len(variances) * (mean - np.log(4.0)), abs=1e-2)


@pytest.mark.long
@pytest.mark.parametrize("criterion", ["D", "A"])
def test_other_criteria_find_good_motions_too(criterion: str, designed: ArmDesign) -> None:
    """The standard deviations of all three are alike: within 20 % in the geometric mean."""
    other = design_arm(ARM, LIMITS, PRIOR, HOME, SECONDS, criterion=criterion)
    assert not violations(other.trajectory, LIMITS)
    assert abs(np.mean(np.log(deviations(other) / deviations(designed)))) < 0.2


def test_it_says_what_it_cannot_show_and_what_to_check(designed: ArmDesign) -> None:
    text = str(designed)
    hidden = [row for row in designed.expected if row.verdict is not Verdict.ESTIMATED]
    assert hidden and all(row.reason for row in hidden) and all(row.name in text for row in hidden)
    for words in ("Collisions were NOT checked", "combinations of masses", "told", "damping", "stay above 0.05 m"):
        assert words in text


def test_a_fit_tells_what_to_expect(designed: ArmDesign, tmp_path: Path) -> None:
    found = fit_arm(ARM, [recorded(designed.trajectory, 7)], {name: {"torque": 1.0} for name in JOINTS})
    file = tmp_path / "fit.json"
    file.write_text(json.dumps(found.to_dict()))
    prior = of_fit(file, JOINTS)
    assert np.allclose(prior.noise, PRIOR.noise, rtol=0.25) and np.all((prior.memory > 0.01) & (prior.memory < 0.2))
    assert np.allclose(prior.damping, VISCOUS, rtol=0.1) and np.allclose(prior.rotor, ROTOR, rtol=0.5)
    promised = deviations(foreseen(REGRESSOR, designed.trajectory, prior))
    assert np.median(promised / deviations(designed)) == pytest.approx(1.0, abs=0.25)
    with pytest.raises(JointIdError, match="not of other"):
        of_fit(file, ("other",))
    file.write_text("{}")
    with pytest.raises(JointIdError, match="no fit of an arm"):
        of_fit(file, JOINTS)
    with pytest.raises(JointIdError, match="cannot be read"):
        of_fit(tmp_path / "none.json", JOINTS)


def test_not_to_know_whether_friction_bends_costs_what_is_told(designed: ArmDesign) -> None:
    unknown = foreseen(REGRESSOR, designed.trajectory, replace(PRIOR, bend=np.full(6, np.nan)))
    bent = foreseen(REGRESSOR, designed.trajectory, replace(PRIOR, bend=COULOMB))
    assert np.allclose(deviations(unknown), deviations(bent))
    told = next(note for note in unknown.notes if "whether friction bends" in note)
    factors = [float(part) for part in re.findall(r"([0-9.]+) times", told)]
    for name, factor in zip(("damping", "friction"), factors, strict=True):
        pairs = zip(unknown.expected, designed.expected, strict=True)
        worse = [a.std_dev / b.std_dev for a, b in pairs if a.name == name]
        assert np.median(worse) == pytest.approx(factor, rel=0.15) and factor > 1.2
    assert not any("whether friction bends" in note for note in bent.notes)


def test_typical_values_need_limits_of_torque() -> None:
    prior = typical(REGRESSOR, LIMITS)
    assert np.allclose(prior.noise / LIMITS.torque, 0.003) and "UR10e" in prior.told
    with pytest.raises(JointIdError, match="joint lift has no limit of torque"):
        typical(REGRESSOR, replace(LIMITS, torque=np.array([1.0, np.inf, 1.0, 1.0, 1.0, 1.0])))
    with pytest.raises(JointIdError, match="has no limit of torque"):  # a design without a prior takes these
        design_arm(ARM, replace(LIMITS, torque=np.full(6, np.inf)))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"home": HOME + 3.0}, "home of turn is 3 rad"),
        ({"reach": -1.0}, "reach = -1 rad: give a number above 0"),
        ({"home": HOME[:5]}, "home has 5 numbers"),
        ({"duration": 2.0}, "too short for a whole arm"),
        ({"shown": ("masses",)}, "known are friction, rotors, links"),
        ({"criterion": "E"}, "choose one of sigma, D, A"),
        ({"floor": 1.0}, "m too low"),
        ({"limits": replace(LIMITS, torque=np.full(6, 10.0))}, "lift needs up to .* Nm to stand at home"),
        ({"limits": replace(LIMITS, velocity=np.full(6, np.inf))}, "no limit of velocity"),
    ],
)
def test_what_cannot_be_designed_is_refused(changes: dict[str, object], text: str) -> None:
    asked: dict[str, object] = {"limits": LIMITS, "home": HOME, "duration": SECONDS, **changes}
    with pytest.raises(JointIdError, match=text):
        design_arm(ARM, prior=PRIOR, **asked)  # type: ignore[arg-type]
