"""`make paper-quick`: every row of the paper's tables once, reduced, and what must come out whatever the size."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from reproduction import cases, figures, page, published, runs, study

pytestmark = pytest.mark.long

DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
IDENTIFIABLE_1 = tuple(published.TABLE_1)
IDENTIFIABLE_3 = tuple(name for name in published.TABLE_3 if name not in ("c_b", "c_m"))


@pytest.fixture(scope="module")
def results() -> page.Results:
    size, tell = study.QUICK, print
    return page.Results(
        size, study.table_2(size, tell), study.table_4(size, tell), study.table_5(size, tell), study.stiff(size, tell),
        {case.model.name: study.shown(case) for case in (cases.model_1(), cases.model_3())}, {},
        study.log(DATA, size.log_s, tell),
    )  # fmt: skip


def one(rows, method, labels, samples=None):
    (found,) = (r for r in rows if (r.method, r.labels) == (method, labels) and samples in (None, r.samples))
    return found


def test_every_row_of_the_paper_is_there(results):
    for rows, printed in ((results.table_2, published.TABLE_2), (results.table_4, published.TABLE_4)):
        for row in printed:
            found = one(rows, row.method, row.labels, row.samples)
            assert found.runs or importlib.util.find_spec("deepxde") is None
            if row.method == "H-PINN":
                assert found.epochs == row.epochs and len(found.best().loss) == row.epochs
    assert {r.method for r in results.table_5} >= {"H-PINN", "NLGR, tanh", "innovations"}


def test_the_engine_is_exact_on_data_without_noise(results):
    """At most 0.1 % off, from a start that is off by up to 30 %, and ahead of the paper's best figure of each row."""
    first, last = one(results.table_2, "innovations", "2", 700), one(results.table_4, "innovations", "5 + torsion")
    for row, names, table in ((first, IDENTIFIABLE_1, published.TABLE_1), (last, IDENTIFIABLE_3, published.TABLE_3)):
        for name in names:
            truth, by_method = table[name]
            assert row.error(name) < 1e-3, name
            assert row.error(name) <= min(abs(value / truth - 1.0) for value in by_method.values()), name
    for run in last.runs:
        total = last.case.truth["c_b"] + last.case.truth["c_m"]
        assert run.values["c_b"] + run.values["c_m"] == pytest.approx(total, rel=1e-3)


def test_h_pinn_predicts_at_least_as_well_as_in_the_paper(results):
    for rows, printed in ((results.table_2, published.TABLE_2), (results.table_4, published.TABLE_4)):
        for row in (r for r in printed if r.method == "H-PINN"):
            assert one(rows, row.method, row.labels, row.samples).mse < row.mse
    loss = one(results.table_4, "H-PINN", "5 + torsion").best().loss
    assert min(loss) < 1e-3 * loss[0]


def test_the_implicit_cell_solves_the_stiff_case_and_rk4_does_not(results):
    explicit, implicit = results.stiff
    assert implicit.best().ended == "converged" and explicit.best().ended != "converged"
    for name in ("R", "k_b", "k_t", "c_m", "c_1", "k_1", "c_q"):
        assert implicit.error(name) < 0.02, name
    assert explicit.error("R") > 10.0 * implicit.error("R")


def test_what_a_step_does_not_show_is_called_not_known(results):
    shown = results.shown["electromechanical"]
    assert shown["k_2"] > page.UNKNOWN and shown["c_b"] > page.UNKNOWN
    assert shown["k_1"] < 0.05 and shown["R"] < 0.05


def test_the_page_has_its_tables_and_pictures(results, tmp_path):
    text = page.page(results)
    for title in ("Table I.", "Table II.", "Table III.", "Table IV.", "Table V"):
        assert title in text
    assert "{" not in text
    assert text.count("(not known)") >= 2 and text.count("| H-PINN |") >= 6
    figures.step(cases.model_3(), tmp_path / "paper_fig4.png")
    figures.training([r for r in results.table_2 if r.samples == 700], tmp_path / "paper_fig6.png")
    figures.training([r for r in results.table_4 if r.labels == "5 + torsion"], tmp_path / "paper_fig7.png")
    figures.motion(results.table_5, tmp_path / "paper_fig8.png")
    for number in (4, 6, 7, 8):
        assert f"images/paper_fig{number}.png" in text
        assert (tmp_path / f"paper_fig{number}.png").stat().st_size > 10_000


def test_the_error_of_a_prediction_is_zero_at_the_truth_only():
    case = cases.model_1(200)
    assert runs.mse(case, case.truth) == 0.0
    assert runs.mse(case, {**case.truth, "k_b": 1.1 * case.truth["k_b"]}) > 1.0


def test_starts_are_off_by_the_factor_at_most_and_differ():
    case = cases.model_3(100)
    starts = [case.start(seed) for seed in range(20)]
    ratios = np.array([[s[n] / case.truth[n] for n in case.free] for s in starts])
    assert np.all(np.abs(np.log(ratios)) <= np.log(cases.FACTOR) + 1e-12)
    assert len({tuple(row) for row in ratios.tolist()}) == 20
    assert all(0.040 <= s["tau_fm"] <= 0.055 for s in starts)
