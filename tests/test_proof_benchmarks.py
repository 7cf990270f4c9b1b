"""Benchmarks of promises and of intervals: what their tables count."""

from __future__ import annotations

import json
from dataclasses import asdict

import bootstrap
import design
import pytest


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
    file = tmp_path / "design.json"
    file.write_text(json.dumps({"machine": "16 cores.", "rows": [asdict(proof(3))]}))
    rows, machine = design.read(file)
    text = design.table(rows, machine)
    assert text.startswith("Joints a case: 3. 16 cores.") and design.line(proof(3)) in text


def test_shares_of_intervals_count_those_that_hold_the_truth():
    """Errors of 1 and 3 with a deviation of 1; the second interval holds the truth, the first does not."""
    ones = [bootstrap.One([e], [low], [4.0], [2.0], [1.0], [1.0]) for e, low in ((1.0, 0.5), (3.0, -0.5))]
    row = bootstrap.row(bootstrap.CASES[0], ones)
    assert (row.by_draws, row.by_deviation) == ([0.5], [0.5])
    assert row.over_deviation[0] == pytest.approx(5.0**0.5) and row.over_scatter[0] == pytest.approx(5.0**0.5 / 2.0)
    assert "| 2 | 50% to 50% | 50% to 50% | 1.12 to 1.12 | 2.24 to 2.24 |" in bootstrap.table([row], "here")
