"""Estimates of separate windows that disagree, although each of them looks well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.online.agreement import KEPT, Agreement
from joint_id_core.results.estimate import Estimate, ParameterChange, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict

from .online_motion import MODEL

WINDOW_S = 2.0


def estimate(end: float, J: float = 2.0, tau_0: float = 0.5, **changes: object) -> Estimate:
    known = {"J": (J, 0.02), "tau_0": (tau_0, 0.1)}
    rows = tuple(
        ParameterEstimate(p.name, p.unit, *known[p.name], Verdict.ESTIMATED)
        if p.name in known
        else ParameterEstimate(p.name, p.unit, p.nominal, 0.0, Verdict.FIXED)
        for p in MODEL.parameters
    )
    whole = Estimate("rigid_joint", "innovations", Status.CONVERGED, "Converged.", rows, end=end)
    fields = {"free": ("J", "tau_0"), "notes": ("Converged.",), "covariance": np.diag([4e-4, 0.01])}
    return replace(whole, **{**fields, **changes})


def told(*estimates: Estimate) -> Agreement:
    agreement = Agreement(MODEL, WINDOW_S)
    for one in estimates:
        assert agreement.on(one) is one
    return agreement


def test_estimates_that_agree_stay_as_they_are():
    told(*(estimate(2.0 * k, 2.0 + 0.01 * (-1) ** k) for k in range(20)))


def test_values_that_disagree_are_told_with_an_interval_that_contains_both():
    found = told(estimate(2.0), estimate(4.0)).on(estimate(6.0, J=3.0))
    assert found.status is Status.DISAGREE and "2.000 ± 0.020 before, 3.000 ± 0.020 now" in found.message
    low, high = (found["J"].value + sign * 1.96 * found["J"].std_dev for sign in (-1.0, 1.0))
    assert low <= 2.0 - 1.96 * 0.02 and high >= 3.0 + 1.96 * 0.02
    assert found["tau_0"] == estimate(6.0)["tau_0"]


def test_a_difference_that_does_not_matter_is_none():
    """What friction does between two samples moves an inertia by a few percent."""
    told(estimate(2.0)).on(estimate(4.0, J=2.15))
    assert told(estimate(2.0)).on(estimate(4.0, J=2.15)).converged


def test_a_change_that_is_told_is_no_disagreement_but_a_second_one_soon_after_is():
    first, second = (ParameterChange("J", 2.0, 0.02, 3.0, 0.02, since=since) for since in (5.0, 9.0))
    agreement = told(estimate(2.0), estimate(4.0), estimate(6.0, J=3.0, changes=(first,)))
    agreement.on(estimate(8.0, J=3.0, tau_0=2.0, changes=(first,)))
    found = agreement.on(estimate(10.0, J=4.0, tau_0=3.0, changes=(second,)))
    assert found.status is Status.DISAGREE and "tau_0" in found.message and "J is" not in found.message


def test_what_was_told_between_a_change_and_its_discovery_does_not_count():
    """The first samples after it, taken for samples of the joint as it was, moved values that did not change."""
    first, second = (ParameterChange("J", 2.0, 0.02, 3.0, 0.02, since=since) for since in (5.0, 9.0))
    agreement = told(estimate(2.0), estimate(4.0), estimate(6.0, J=3.0, changes=(first,)))
    agreement.on(estimate(8.7, J=3.1, tau_0=2.0, changes=(first,)))
    assert agreement.on(estimate(10.0, J=4.0, changes=(second,))).converged


def test_old_values_are_forgotten_after_some_windows_that_agree():
    agreement = told(estimate(2.0))
    found = [agreement.on(estimate(4.0 + 2.0 * k, J=3.0)).status for k in range(KEPT + 2)]
    assert found[:KEPT] == [Status.DISAGREE] * KEPT and found[-1] is Status.CONVERGED


def test_a_memory_that_is_replaced_once_counts_anew_but_not_twice():
    agreement = told(estimate(2.0))
    agreement.replaced()
    assert agreement.on(estimate(6.0, J=3.0)).converged
    agreement.replaced()
    assert agreement.on(estimate(10.0, J=4.0)).status is Status.DISAGREE


@pytest.mark.parametrize(("fits", "status"), [(1, Status.CONVERGED), (6, Status.DISAGREE)])
def test_a_new_memory_after_many_other_fits_is_no_proof_of_a_change(fits, status):
    agreement = told(estimate(2.0))
    for k in range(20):
        agreement.on(estimate(3.0 + k, J=10.0 + k % fits, status=Status.POOR_FIT))
    agreement.replaced()
    assert agreement.on(estimate(30.0, J=3.0)).status is status


def test_estimates_that_did_not_converge_are_left_alone():
    one = estimate(4.0, J=9.0, status=Status.POOR_FIT)
    assert told(estimate(2.0)).on(one) is one
