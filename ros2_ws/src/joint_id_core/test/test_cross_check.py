"""An estimate is checked by a second estimator with other assumptions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit
from joint_id_core.estimators.cross_check import cross_checked
from joint_id_core.estimators.innovations.verdicts import Shown, informative
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, Status, Verdict
from joint_id_core.simulation.motion import simulate_motion
from joint_id_core.simulation.simulator import simulate

from .controlled_joint import TRUTH as CONTROLLED
from .controlled_joint import controlled
from .online_motion import MODEL, TRUTH, motion
from .quick import first_quick


@pytest.fixture(scope="module")
def good() -> Estimate:
    return fit(MODEL, motion())


def off(estimate: Estimate, name: str, factor: float) -> Estimate:
    """The same estimate with one value that is wrong by a factor, and with its relative standard deviation."""
    rows = tuple(
        replace(p, value=factor * p.value, std_dev=abs(factor) * p.std_dev) if p.name == name else p
        for p in estimate.parameters
    )
    scale = np.array([abs(factor) if n == name else 1.0 for n in estimate.free])
    return replace(estimate, parameters=rows, covariance=estimate.covariance * np.outer(scale, scale))


def test_what_both_find_stays_as_it_is(good):
    assert good.converged and cross_checked(good, MODEL, motion()) is good


@pytest.mark.parametrize("estimator", [Innovations(), Regression()], ids=lambda e: e.name)
@pytest.mark.parametrize("late_s", first_quick([-0.01, -0.005, 0.01]))
def test_intervals_contain_what_a_drive_that_is_not_in_time_does(late_s, estimator):
    """Early, it takes c for negative: what is held at its bound is no bound of what is true."""
    record = motion()
    torque = np.interp(record.time - late_s, record.time, record["torque"])
    found = fit(MODEL, record.with_channels({"torque": torque}), estimator=estimator)
    assert "The drive seems to be" in " ".join(found.notes)
    for name, truth in TRUTH.items():
        assert abs(found[name].value - truth) < 2.0 * found[name].std_dev, (name, found[name])


def test_where_both_disagree_about_a_late_drive_the_lag_is_told_and_all_intervals_contain_what_it_does():
    """The lag was said to be likely, below; and c, on which both agreed, was 3 standard deviations off."""
    model = build("rigid_joint")
    record = simulate_motion(model, 8.0)
    torque = np.interp(record.time - 0.01, record.time, record["torque"])
    found = fit(model, record.with_channels({"torque": torque}))
    assert found.status is Status.DISAGREE, found.message
    assert found.notes[1].startswith("The drive seems to be") and "ost likely" not in " ".join(found.notes)
    for name in found.free:
        assert abs(found[name].value - model.parameter(name).nominal) < 2.0 * found[name].std_dev, (name, found[name])


def test_a_drive_that_is_far_too_late_is_no_good_fit_and_says_so_once():
    """40 ms, as of a driver that stamps late: a fit of such a motion converged, with J = 0."""
    record = motion()
    torque = np.interp(record.time - 0.04, record.time, record["torque"])
    found = fit(MODEL, record.with_channels({"torque": torque}))
    assert not found.converged and " ".join(found.notes).count("The drive seems to be 40 ms late") == 1, found.notes


def test_an_offset_alone_tells_nothing_of_the_joint():
    shown = {name: Shown(Verdict.ESTIMATED if name == "tau_0" else Verdict.PRIOR, "") for name in ("J", "tau_0")}
    assert not informative(MODEL, shown)
    assert informative(MODEL, {**shown, "J": replace(shown["J"], verdict=Verdict.ESTIMATED)})


@pytest.mark.parametrize(("name", "factor"), [("J", 3.0), ("J", 0.3), ("tau_f", 1.5), ("tau_0", -2.0)])
def test_a_wrong_value_with_a_small_interval_is_said_and_widened(good, name, factor):
    wrong = off(good, name, factor)
    found = cross_checked(wrong, MODEL, motion())
    assert found.status is Status.DISAGREE and not found.converged
    row, k = found[name], found.free.index(name)
    lowest, highest = row.value - 1.96 * row.std_dev, row.value + 1.96 * row.std_dev
    assert lowest < TRUTH[name] < highest and lowest < wrong[name].value < highest
    assert abs(row.value - TRUTH[name]) < 0.6 * abs(wrong[name].value - TRUTH[name])  # it lies between
    assert np.sqrt(found.covariance[k, k]) == pytest.approx(row.std_dev, rel=1e-6)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    assert "by innovations" in row.reason and "by regression" in row.reason
    assert found.message.startswith(f"{name[:1].upper()}{name[1:]} is ") and "most likely" in found.message.lower()
    for other in set(TRUTH) - {name}:  # in doubt by what they are apart
        assert found[other].value == good[other].value
        assert good[other].std_dev < found[other].std_dev < 0.05 * max(1.0, abs(TRUTH[other]))
        lowest, highest = map(float, found[other].reason.removeprefix("95 % interval ").split(" to "))
        assert highest - lowest == pytest.approx(2.0 * 1.96 * found[other].std_dev, rel=0.01, abs=2e-3)


def test_a_difference_that_does_not_matter_is_none(good):
    assert cross_checked(off(good, "J", 1.05), MODEL, motion()).converged


def test_an_interval_that_says_little_is_not_wrong(good):
    wide = replace(good["J"], value=3.0 * TRUTH["J"], std_dev=2.0 * TRUTH["J"])
    rows = tuple(wide if p.name == "J" else p for p in good.parameters)
    assert cross_checked(replace(good, parameters=rows), MODEL, motion()).converged


def test_what_the_user_believes_is_not_checked(good):
    """Only what the others then are."""
    wrong = off(good, "J", 3.0)
    believed = cross_checked(wrong, MODEL, motion(), ParameterSettings(priors={"J": 0.01}))
    assert not any("J is" in note for note in believed.notes) and believed["J"] == wrong["J"]
    assert cross_checked(wrong, MODEL, motion(), ParameterSettings(fixed=["c"])).status is Status.DISAGREE


def test_another_model_is_not_checked():
    estimate = Estimate("motor_side", "innovations", Status.CONVERGED, "Converged.", ())
    assert cross_checked(estimate, build("motor_side"), motion()) is estimate


def with_load(record: Recording) -> Recording:
    """The same recording with the torque of a load that another joint moves, in a rhythm of its own."""
    return record.with_channels({"torque": record["torque"] + 6.0 * np.sin(0.3 * record.time**1.3)})


def test_a_load_of_other_joints_is_a_poor_fit_by_either(good):
    record = with_load(motion())
    alone = fit(MODEL, record, estimator=Regression())
    assert alone.status is Status.POOR_FIT and "other joints" in alone.message
    found = cross_checked(good, MODEL, record)
    assert found.status is Status.POOR_FIT and "other joints" in found.message
    assert found.parameters == good.parameters


@pytest.mark.parametrize("seed", first_quick([0, 2]))
def test_of_a_disturbance_with_a_memory_in_a_closed_loop_the_regression_is_proposed_or_intervals_hold(seed):
    """The controller reacts to the disturbance, so it goes with the motion, and white noise does not describe it.

    Which of the two it is may hang on the last bits.
    """
    record = controlled(disturbance=0.5, memory_s=0.15, seed=seed)
    found, second = fit(MODEL, record), fit(MODEL, record, estimator=Regression())
    assert found.converged or "--estimator regression" in found.message
    assert second.converged
    for estimate in (found, second) if found.converged else (second,):
        for name, truth in CONTROLLED.items():
            assert abs(estimate[name].value - truth) < 3.0 * estimate[name].std_dev
    assert all(second[name].verdict is Verdict.ESTIMATED for name in CONTROLLED)


def test_advice_that_would_not_help_is_not_given():
    """In a closed loop a disturbance with a memory looks like gravity, by many standard deviations; there is none."""
    found = fit(MODEL, controlled(disturbance=1.0, memory_s=0.15))
    text = " ".join(found.notes)
    assert "a load that goes with the angle" in text and "--gravity would predict new samples no better" in text
    assert "try --gravity" not in text


def test_advice_that_helps_is_given():
    record, loaded = motion(), build("rigid_joint", gravity=True)
    moved = simulate(loaded, record.time, {"torque": record["torque"]}, {**TRUTH, "a_g": 1.0, "b_g": 1.0})
    found = fit(MODEL, Recording(record.time, {"link_position": moved["link_position"], "torque": record["torque"]}))
    assert "try --gravity" in found.message and "no better" not in " ".join(found.notes)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_a_regression_that_cannot_see_the_gear_has_no_say(seed):
    """Its instruments do not show the spring in a fast motion: what was left of the torque made a good fit poor."""
    model = build("motor_side")
    values = model.values({})
    record = simulate_motion(model, 6.0, 500.0, values, True, seed)
    found = fit(model, record)
    assert found.status is Status.CONVERGED, found.message
    for name in ("J_m", "c_m", "tau_fm", "k_1"):
        assert abs(found[name].value - values[name]) < 4.0 * found[name].std_dev
