"""Late drives and encoders, changed gains and wrong gear ratios of flexible joints are named, with their sizes."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.regression.side_faults import side_fault
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation import simulate_motion

from .quick import first_quick

MODEL, N = build("harmonic_drive"), 101.0
TRUTH = {"k_1": 8000.0, "J_q": 1.2, "c_q": 3.0, "tau_fm": 0.035, "J_m": 8e-5}


@pytest.fixture(scope="module")
def good() -> Recording:
    return simulate_motion(MODEL, 4.0, values=TRUTH)


def later(name: str, seconds: float) -> Callable[[Recording], Recording]:
    return lambda r: r.with_channels({name: np.interp(r.time - seconds, r.time, r[name])})


def scaled(name: str, factor: float, begin: float = 0.0) -> Callable[[Recording], Recording]:
    return lambda r: r.with_channels({name: r[name] * np.where(r.time >= begin, factor, 1.0)})


FAULTS = {
    "late drive": (later("torque", 0.004), N, r"the torque is (\S+) ms late", 4.0, 0.15),
    "early drive": (later("torque", -0.004), N, r"the torque is (\S+) ms early", 4.0, 0.15),
    "late link": (later("link_position", 0.004), N, r"the link's encoder is (\S+) ms late", 4.0, 0.1),
    "gear": (scaled("torque", 1.0), 100.0, r"correct N \(--set N=([\d.]+)\)", 101.0, 0.05),
    "link gain": (scaled("link_position", 1.02), N, r"--map link_position=([\d.]+)\*COLUMN", 1.0 / 1.02, 0.0005),
    "drive gain": (scaled("torque", 1.1, 2.0), N, r"the torque is (\S+) times what", 1.1, 0.01),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_size(good, fault):
    make, ratio, text, size, accuracy = FAULTS[fault]
    found = re.search(text, side_fault(make(good), "torque", ratio))
    assert found is not None and float(found[1]) == pytest.approx(size, abs=accuracy)


@pytest.mark.parametrize("model", first_quick(["harmonic_drive", "motor_side", "electromechanical"]))
@pytest.mark.parametrize("rate", first_quick([125.0, 500.0]))
def test_good_recordings_have_no_fault(model, rate):
    drive = "current" if model == "electromechanical" else "torque"
    for seed, friction in enumerate(("coulomb_viscous", "stribeck", "eyring")):
        recording = simulate_motion(build(model, friction=friction), 4.0, rate, seed=seed)
        assert side_fault(recording, drive, N) == ""


@pytest.mark.parametrize(
    "other",
    [
        lambda r: r.with_channels({"link_position": r["link_position"] + 0.02}),
        lambda r: r.with_channels({"link_position": r["link_position"] + 0.005 * r.time}),
        lambda r: r.with_channels({"link_position": r["link_position"] + 1e-3 * np.sin(r["link_position"] + 1.0)}),
        lambda r: r.with_channels({"torque": np.clip(r["torque"], -0.1, 0.1)}),
        lambda r: r.with_channels({"torque": np.where(np.abs(r.time - 2.0) < 0.4, r["torque"][800], r["torque"])}),
    ],
    ids=["offset", "drift", "eccentric disc", "clipped", "frozen"],
)
def test_what_is_wrong_otherwise_is_not_taken_for_one_of_these(good, other):
    assert side_fault(other(good), "torque", N) == ""


@pytest.mark.long
def test_a_torque_of_the_wrong_sign_is_named(good):
    wrong = scaled("torque", -1.0)(good)
    assert "acts against the motion: its sign is wrong (--map torque=-1*COLUMN)" in side_fault(wrong, "torque", N)
    for model in ("harmonic_drive", "motor_side"):
        assert "The torque acts against the motion" in fit(build(model), wrong).message


@pytest.mark.parametrize("late", [0.005, *(pytest.param(s, marks=pytest.mark.long) for s in (0.002, 0.008))])
def test_a_late_link_of_a_spring_that_is_not_linear_is_found_beside_its_twist(late):
    """The twist alone says 0.2 ms too little, at which four times as much is left as a fault may leave."""
    recording = simulate_motion(build("motor_side"), 3.0, values={"k_1": 8000.0, "J_m": 8e-5}, seed=3)
    found = re.search(r"encoder is (\S+) ms late", side_fault(later("link_position", late)(recording), "torque", N))
    assert found is not None and float(found[1]) == pytest.approx(1e3 * late, abs=0.1)


def test_two_encoders_that_both_move_are_needed(good):
    still = good.with_channels({"link_position": np.full(len(good), 0.2)})
    one = Recording(good.time, {n: good[n] for n in ("motor_position", "torque")})
    assert side_fault(still, "torque", N) == side_fault(one, "torque", N) == ""


@pytest.mark.parametrize("ratio", [60.0, 100.0])
def test_a_short_recording_with_a_wrong_gear_ratio_says_which_one_it_is(good, ratio):
    found = fit(MODEL, good.slice(0, 750), ParameterSettings({"N": ratio}))  # too few to tell it before a fit
    assert found.status in (Status.POOR_FIT, Status.DIVERGED)
    assert found.message.startswith("Motor_position goes 101 times as far as link_position")
