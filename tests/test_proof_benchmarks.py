"""Benchmarks of promises and of intervals: what their tables count."""

from __future__ import annotations

import argparse

import arm_stats
import bootstrap
import design
import design_bound
import numpy as np
import pytest
from measured_blocks import add_options, rows_of

from joint_id_core.arm.arm_estimate import Value
from joint_id_core.data.recording import Array
from joint_id_core.design.foresight import Foresight
from joint_id_core.results.verdict import Verdict


def proof(converged: int) -> design.Row:
    """Promises of 1 % and 2 %, kept and broken by a factor of 2; a multisine that is four times worse."""
    designed = design.Realised([0.01, 0.02], [0.01, 0.04], 3)
    multisine = design.Realised([0.04, 0.08], [0.04, 0.16], converged)
    return design.Row("a case", ("J", "c"), 3, designed, multisine, 1.5)


def test_a_line_tells_the_broken_promise_and_the_gain():
    line = design.line(proof(3))
    assert "| 3 of 3 | 1.00 (`J`) to 2.00 (`c`), 1.41 |" in line and "| 4.00, 4.00 | 1.5 s |" in line


def test_a_motion_whose_fits_fail_has_no_gain():
    line = design.line(proof(1))
    assert "1 of 3 fits converge" in line and "| 4.00, - |" in line


def test_a_result_of_another_machine_is_read_again(tmp_path):
    parser = argparse.ArgumentParser()
    add_options(parser, "benchmarks.md")
    file = str(tmp_path / "design.json")
    rows, machine = rows_of(parser.parse_args(["--json", file, "--workers", "3"]), iter([proof(3)]), design.of_json)
    assert rows == [proof(3)] and machine.endswith("cores, 3 processes.")
    again = rows_of(parser.parse_args(["--from", file]), iter(()), design.of_json)
    assert again[1] == machine and design.table(*again) == design.table(rows, machine)
    assert design.line(proof(3)) in design.table(*again)


def test_shares_of_intervals_count_those_that_hold_the_truth():
    """Errors of 1 and 3 with a deviation of 1; the second interval holds the truth, the first does not."""
    ones = [bootstrap.One([e], [low], [4.0], [2.0], [1.0], [1.0]) for e, low in ((1.0, 0.5), (3.0, -0.5))]
    row = bootstrap.row(bootstrap.CASES[0], ones)
    assert (row.by_draws, row.by_deviation) == ([0.5], [0.5])
    assert row.over_deviation[0] == pytest.approx(5.0**0.5) and row.over_scatter[0] == pytest.approx(5.0**0.5 / 2.0)
    assert "| 2 | 50% to 50% | 50% to 50% | 1.12 to 1.12 | 2.24 to 2.24 |" in bootstrap.table([row], "here")


def test_the_joint_without_a_bias_obeys_the_model_of_the_fit():
    """Where it slides, the momentum that it gains between two samples is that of drive and friction."""
    exact, p = bootstrap.smooth(), bootstrap.MODEL.values()
    w, torque = exact["link_velocity"], exact["torque"]
    sliding = (np.abs(w[:-1]) > 0.2) & (w[:-1] * w[1:] > 0.0) & (np.abs(w[1:]) > 0.2)
    moved = np.diff(exact["link_position"])
    friction = p["c"] * moved * bootstrap.RATE + np.sign(w[:-1]) * p["tau_f"] + p["tau_0"]
    gained = (torque[:-1] - friction) / (p["J"] * bootstrap.RATE)
    assert np.count_nonzero(sliding) > 100 and np.ptp(np.sign(w)) == 2.0
    np.testing.assert_allclose(np.diff(w)[sliding], gained[sliding], atol=1e-9)


def test_errors_over_sigma_count_what_is_estimated_and_all_base_parameters():
    """Errors of 1 and 3 sigma; a value that is not estimated counts of base parameters only."""
    values = [Value(2.0, 1.0, "", Verdict.ESTIMATED, ""), Value(4.0, 1.0, "", Verdict.PRIOR, "")]
    pairs = [(value, 1.0) for value in values]
    row = arm_stats.Row.of("ur5e", False, {arm_stats.BASE: pairs, "gains": pairs})
    bent = arm_stats.Row("ur5e", True, row.errors, row.sigmas, row.truths, row.all)
    lines = arm_stats.table([row, bent], "here").splitlines()
    told = "| 2 of 2 | 2.24 | 0.500 | 1e+02 % |"
    assert lines[-2:] == [f"| {arm_stats.BASE} {told}{told[1:]}", lines[-1]]
    assert lines[-1] == "| gains | 1 of 2 | 1.00 | 1.000 | 1e+02 % | 1 of 2 | 1.00 | 1.000 | 1e+02 % |"


@pytest.mark.long
def test_a_fit_of_a_simulated_arm_has_every_group_near_its_truth():
    row = arm_stats.fitted(4)
    assert row.bent and all(row.errors.values())
    for group, errors in row.errors.items():
        ratio = np.sqrt(np.mean((np.array(errors) / row.sigmas[group]) ** 2))
        assert ratio < 2.5, group
    assert row.all == {**row.all, arm_stats.BASE: 40, "payload, mass": 1, "payload, centre": 3, "gains": 6}


def test_the_best_mixture_is_found_and_a_better_motion_outside_of_it_is_told():
    """Each of two motions is blind to what the other shows: half of the time for either is best."""
    case = design.CASES[5]
    free = Foresight(case.model, case.settings).free
    assert set(case.names) == {"J", "c", "tau_f"}

    def blind_to(name: str) -> Array:
        return np.diag([1e-2 if one == name else 1e-4 for one in free])

    plain, better = 1e-2 * np.eye(len(free)), 1e-5 * np.eye(len(free))
    known = [plain, blind_to("J"), blind_to("c")]
    found = design_bound.row(case, known, [plain, *known[1:]])
    half = 2.0 / (1e4 + 1e2)
    assert found.mixture == pytest.approx((half * half * 1e-4) ** (1.0 / 6.0), rel=1e-3)
    assert found.mixture < found.single < found.multisine and found.sensitivity <= 1.0 + design_bound.NEAR
    assert design_bound.row(case, known, [better]).sensitivity > 5.0
