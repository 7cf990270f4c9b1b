"""How parameters went over many estimates: trends are told from chance."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from typer.testing import CliRunner

from joint_id_core.cli import app
from joint_id_core.models import build
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.history import DAY_S, courses, known
from joint_id_core.results.history_plot import figure
from joint_id_core.results.verdict import Verdict


def estimate(day: float, c: float, sigma: float, joint: str = "elbow") -> Estimate:
    rows = (
        ParameterEstimate(q.name, q.unit, c, sigma, Verdict.ESTIMATED)
        if q.name == "c"
        else ParameterEstimate(q.name, q.unit, q.nominal, np.nan, Verdict.FIXED)
        for q in build("rigid_joint").parameters
    )
    return Estimate(
        "rigid_joint", "regression", Status.CONVERGED, "", tuple(rows), ("c",), np.array([[sigma**2]]), joint=joint,
        origin=1_700_000_000 + int(day * DAY_S), start=0.0, end=20.0, samples=100,
    )  # fmt: skip


def test_a_line_is_found_with_the_standard_deviation_of_weighted_least_squares():
    days, sigma = np.array([0.0, 1.0, 4.0, 9.0]), np.array([0.1, 0.2, 0.1, 0.3])
    values = 10.0 + 0.5 * days
    course = courses(known([estimate(d, v, s) for d, v, s in zip(days, values, sigma, strict=True)][::-1]))[0]
    A = np.column_stack([np.ones(4), days]) / sigma[:, None]
    assert course.slope == pytest.approx(0.5, rel=1e-6)
    assert course.slope_std_dev == pytest.approx(np.sqrt(np.linalg.inv(A.T @ A)[1, 1]), rel=1e-6)
    assert "a trend" in course.trend and list(course.days) == pytest.approx(list(days))


@pytest.mark.parametrize("count", [3, 4, 12])
def test_scatter_beyond_the_intervals_is_no_trend(count):
    """At most one in some hundred courses without a trend is called one, also where the intervals are too narrow."""
    rng, called = np.random.default_rng(0), 0
    for _ in range(300):
        values = 10.0 + rng.standard_normal(count)
        called += "a trend" in courses(known([estimate(k, v, 0.1) for k, v in enumerate(values)]))[0].trend
    assert called <= 6


def test_a_picture_has_whole_numbers_at_its_axes_and_says_what_the_bars_are():
    drawn = figure(courses(known([estimate(k, 1000.0 + 1e-4 * k, 1e-5) for k in range(3)])))
    FigureCanvasAgg(drawn).draw()
    assert drawn.axes[0].yaxis.get_offset_text().get_text() == ""
    assert drawn.get_supxlabel() == "bars: 95 % intervals"


def test_a_folder_is_a_table_and_a_picture_and_what_is_no_estimate_is_named(tmp_path):
    for k in range(5):
        estimate(k, 10.0 + 0.3 * k, 0.1).save(tmp_path / f"{k}.json")
    estimate(0, 3.0, 0.1, "wrist").save(tmp_path / "wrist.json")
    replace(estimate(9, 99.0, 0.1), status=Status.POOR_FIT).save(tmp_path / "poor.json")
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "deep.json").write_text("[" * 100000)
    (tmp_path / "damaged.json").write_text((tmp_path / "0.json").read_text().replace('"std_dev": 0.1', '"std_dev": -1'))
    picture = tmp_path / "out.png"
    done = CliRunner().invoke(app, ["history", str(tmp_path), "--plot", str(picture), "--json"])
    assert done.exit_code == 0 and picture.stat().st_size > 5000
    told = json.loads(done.stdout)["courses"]
    assert [(c["joint"], len(c["values"])) for c in told] == [("elbow", 5), ("wrist", 1)]
    assert "fewer than 3" in told[1]["trend"] and told[0]["values"][-1] == pytest.approx(11.2)
    for name in ("other", "deep", "damaged"):
        assert f"{name}.json: " in done.stderr
    assert done.stderr.count("\n") == 4 and "1 of 7 estimates" in done.stderr
    text = CliRunner().invoke(app, ["history", str(tmp_path)]).stdout
    assert "elbow" in text and re.search(r"\+2\.[89]\d ± 0\.\d+ % a day", text)


def test_recordings_without_dates_keep_the_order_of_their_files(tmp_path):
    """The time of most CSV files begins at zero: once the smallest value was called the first one."""
    for week, (c, end) in {1: (10.3, 20.0), 2: (10.1, 30.0), 10: (10.2, 5.0)}.items():
        replace(estimate(0, c, 0.1), origin=0, end=end).save(tmp_path / f"week{week}.json")
    done = CliRunner().invoke(app, ["history", str(tmp_path), "--plot", str(tmp_path / "out.png"), "--json"])
    (told,) = json.loads(done.stdout)["courses"]
    assert told["values"] == pytest.approx([10.3, 10.1, 10.2])
    assert "no trend" in told["trend"] and "a file" in told["trend"] and not any(told["days"])
    assert told["slope_a_day"] is None


def test_wear_is_told_of_recordings_without_dates_too_and_files_can_be_named(tmp_path):
    files = [tmp_path / f"week{k}.json" for k in (1, 2, 3, 4)]
    for k, file in enumerate(files):
        replace(estimate(0, 10.0 + 0.5 * k, 0.1), origin=0).save(file)
    done = CliRunner().invoke(app, ["history", *map(str, files)])
    assert done.exit_code == 0 and "+4.65 ± 0.42 % a file, 11.2 sigma: a trend" in done.stdout
    assert "without dates: their estimates are taken in the order of the files" in done.stdout
    two = CliRunner().invoke(app, ["history", *map(str, files[:2])])
    assert "fewer than 3 estimates" in two.stdout
    assert CliRunner().invoke(app, ["history", str(files[0]), str(tmp_path / "no.json")]).stderr.count("no.json") == 1


def test_the_trend_of_what_may_be_zero_is_no_share_of_it(tmp_path):
    files = [tmp_path / f"week{k}.json" for k in (1, 2, 3)]
    for file, c in zip(files, (0.02, 0.04, 0.03), strict=True):
        replace(estimate(0, c, 0.1), origin=0).save(file)
    done = CliRunner().invoke(app, ["history", *map(str, files)])
    assert re.search(r"\+0\.0050? ± \S+ Nm s/rad a file", done.stdout) and "%" not in done.stdout


def test_long_numbers_do_not_touch_each_other(tmp_path):
    estimate(0.0, 1.0302e-04, 8.5e-07).save(tmp_path / "a.json")
    shown = CliRunner().invoke(app, ["history", str(tmp_path)])
    assert "  1   1.0302e-04 ± 8.5e-07   1.0302e-04 ± 8.5e-07  " in shown.stdout


def test_a_folder_without_estimates_is_said(tmp_path):
    done = CliRunner().invoke(app, ["history", str(tmp_path)])
    assert done.exit_code == 2 and "no good estimate" in done.output
    assert CliRunner().invoke(app, ["history", str(tmp_path / "no")]).exit_code == 2


def test_a_folder_that_may_not_be_read_is_not_called_empty(tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir(mode=0)
    if os.access(folder, os.R_OK):
        pytest.skip("this user may read everything")
    result = CliRunner().invoke(app, ["history", str(folder)])
    assert result.exit_code == 2 and f"{folder}: Permission denied: check the path, its permissions" in result.output
