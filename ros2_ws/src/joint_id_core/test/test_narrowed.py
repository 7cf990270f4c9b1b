"""Where the model lacks something and both estimators agree, intervals are those that depend less on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.narrowed import narrowed
from joint_id_core.estimators.opinion import Opinion, Second
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, Status, Verdict

from .online_motion import MODEL, TRUTH, motion


@pytest.fixture(scope="module")
def wide() -> Estimate:
    """A good estimate, with standard deviations of a tenth and residuals that are not white."""
    good = fit(MODEL, motion())
    assert good.converged and good.checks is not None
    sigma = {n: 0.1 * max(abs(TRUTH[n]), 1.0) for n in good.free}
    rows = tuple(replace(p, std_dev=sigma[p.name]) if p.name in sigma else p for p in good.parameters)
    scale = np.array([sigma[n] for n in good.free]) / np.sqrt(np.diag(good.covariance))
    checks = replace(good.checks, texts=("the residuals are not white",))
    return replace(good, parameters=rows, covariance=good.covariance * np.outer(scale, scale), checks=checks)


def opinion(estimate: Estimate, name: str, deviations: float, sigma: float, doubt: float = 0.0) -> Opinion:
    """What a regression says of one parameter, some of the estimate's standard deviations away."""
    row = estimate[name]
    return Opinion("", (Second(name, row.value + deviations * row.std_dev, sigma * row.std_dev, 1.0, doubt),), 0.99)


@pytest.mark.parametrize("name", ["J", "tau_f"])
def test_the_interval_contains_that_of_the_regression_and_the_distance(wide, name):
    found, before = narrowed(wide, MODEL, opinion(wide, name, 0.3, 0.2)), wide[name]
    row, k = found[name], found.free.index(name)
    assert row.value == before.value, "values belong together, and predictions are theirs"
    assert row.std_dev == pytest.approx(math.hypot(0.2 * before.std_dev, 0.3 * before.std_dev, 0.01 * row.value))
    assert row.verdict is Verdict.ESTIMATED
    assert np.sqrt(found.covariance[k, k]) == pytest.approx(row.std_dev)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0
    others = [n for n in found.free if n != name]
    assert [found[n] for n in others] == [wide[n] for n in others]
    assert f"The intervals of {name} are those of a regression" in found.message


def test_a_regression_that_holds_what_the_user_freed_does_not_know_what_that_adds(wide):
    assert narrowed(wide, MODEL, replace(opinion(wide, "c", 0.3, 0.2), holds=True)) is wide


def test_a_prior_of_the_torque_constant_reaches_all_intervals():
    """Only the scale of all torques is told by the prior, and the residuals are not white."""
    driven, recording = build("rigid_joint", actuation="current"), motion()
    still = np.sin(40.0 * recording["link_position"])  # a ripple, which the model lacks
    current = recording.with_channels({"current": recording["torque"] / 0.1 + 0.3 * still})
    found = fit(driven, current, ParameterSettings({"k_t": 0.1}, freed=["k_t"], priors={"k_t": 0.2}))
    for name in ("k_t", "J", "c", "tau_f"):
        assert found[name].std_dev > 0.18 * found[name].value, name


def test_a_value_of_which_only_the_size_was_known_is_estimated_then(wide):
    rows = tuple(replace(p, verdict=Verdict.PRIOR) if p.name == "c" else p for p in wide.parameters)
    notes = (*wide.notes, "This motion does not show c, tau_0.", "This motion does not show c.")
    found = narrowed(replace(wide, parameters=rows, notes=notes), MODEL, opinion(wide, "c", 0.1, 0.1))
    assert found["c"].verdict is Verdict.ESTIMATED
    assert [n for n in found.notes if "does not show" in n] == ["This motion does not show tau_0."]


def test_values_stay_that_are_known_as_well_or_are_apart_or_in_doubt(wide):
    for said in (
        opinion(wide, "J", 0.1, 0.9),
        opinion(wide, "J", 0.9, 0.1),
        opinion(wide, "J", 0.1, 0.1, doubt=wide["J"].std_dev),
    ):
        assert narrowed(wide, MODEL, said) is wide


def test_of_two_that_disagree_the_parameters_that_they_agree_on_are_known_better(wide):
    rows = tuple(
        replace(p, reason="2 ± 0.1 by innovations, 1 ± 0.1 by regression") if p.name == "J" else p
        for p in wide.parameters
    )
    apart = replace(wide, parameters=rows, status=Status.DISAGREE)
    seconds = tuple(s for n in ("J", "c") for s in opinion(wide, n, 0.1, 0.1).seconds)
    found = narrowed(apart, MODEL, replace(opinion(wide, "c", 0.1, 0.1), seconds=seconds))
    assert found["J"] == apart["J"] and found["c"].std_dev < 0.5 * wide["c"].std_dev


def test_an_estimate_stays_that_describes_all_or_nothing_or_is_corrected(wide):
    said = opinion(wide, "J", 0.1, 0.1)
    white = replace(wide, checks=replace(wide.checks, texts=("",)))
    corrected = replace(wide, checks=replace(wide.checks, bias=np.zeros(len(wide.free))))
    for estimate in (white, corrected, replace(wide, status=Status.POOR_FIT)):
        assert narrowed(estimate, MODEL, said) is estimate
    assert narrowed(white, MODEL, replace(said, coloured=True))["J"].std_dev < 0.5 * wide["J"].std_dev
