"""The report: one file that a browser shows without a network, with all that is known of the fit."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.data.recording import Recording
from joint_id_core.pages import series
from joint_id_core.pages.contents import Contents
from joint_id_core.pages.joints import report_of_joints
from joint_id_core.pages.report import report
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status, Verdict

from . import browser
from .online_motion import motion

needs_browser = pytest.mark.skipif(browser.PROGRAM is None, reason=browser.MISSING)


@pytest.fixture
def page(tmp_path, run_here):
    """A report of a motion with a gap, and of its comparison with an estimate of another one."""
    formats.write(tmp_path / "monday.csv", motion(8.0, seed=1))
    assert run_here("fit", "monday.csv", "--save", "monday.json")[0] == 0
    whole = motion(12.0)
    kept = (whole.time < 4.0) | (whole.time > 6.0)
    channels = {n: v[kept] for n, v in whole.channels.items()}
    formats.write(tmp_path / "friday.csv", Recording(whole.time[kept], channels))
    code, out = run_here("report", "friday.csv", "--against", "monday.json", "-o", "friday.html")
    assert code == 0, out
    return tmp_path / "friday.html"


@pytest.fixture
def estimate():
    """A stiffness and a ratio."""
    rows = (
        ParameterEstimate("k_1", "Nm/rad", 3741.2, 752.0, Verdict.ESTIMATED),
        ParameterEstimate("N", "1", 101.0, 2.0, Verdict.ESTIMATED),
    )
    return Estimate("harmonic_drive", "innovations", Status.CONVERGED, "Converged.", rows)


def plots(text: str) -> list[dict]:
    return json.loads(re.search(r'<script id="plots"[^>]*>(.*?)</script>', text, re.DOTALL)[1])


def test_a_report_has_all_parts_in_one_small_file_that_fetches_nothing(page):
    text = page.read_text()
    assert len(text) < 1e6
    for title in (
        "Parameters", "Measured and predicted", "Inputs", "While the motion goes on", "Samples that were not fitted",
        "Correlations", "Compared with an earlier estimate", "The recording", "How to repeat it",
    ):  # fmt: skip
        assert f"<h2>{title}</h2>" in text
    own = text.replace("http://www.w3.org/", "").replace("https://github.com/leeoniya/uPlot", "")
    assert "src=" not in own.split("<body>")[1].split("<script")[0] and "<link" not in own and "@import" not in own
    titles = [p["title"] for p in plots(text)]
    assert {"link position [rad]", "error of link position [rad]", "torque [Nm]", "J [kg m^2]"} <= set(titles)


@pytest.mark.long
def test_no_curve_runs_across_a_gap(page):
    position = next(p for p in plots(page.read_text()) if p["title"] == "link position [rad]")
    time, measured, predicted = position["data"]
    inside = [k for k, t in enumerate(time) if 4.05 < t < 5.95]
    assert inside and all(measured[k] is None and predicted[k] is None for k in inside)


def test_a_signal_that_comes_seldom_is_a_curve_all_the_same(tmp_path, run_here):
    """A robot sends the temperature of a joint twice a second, and samples 500 times."""
    record = motion(4.0)
    seldom = np.where(np.arange(len(record)) % 100 == 0, 27.0 + 0.1 * record.time, np.nan)
    formats.write(tmp_path / "warm.csv", record.with_channels({"temperature": seldom}))
    assert run_here("report", "warm.csv", "-o", "warm.html")[0] == 0
    text = (tmp_path / "warm.html").read_text()
    time, shown = next(p for p in plots(text) if p["title"].startswith("temperature"))["data"]
    assert len(time) == 10 and None not in shown


@needs_browser
@pytest.mark.parametrize("width", [390, pytest.param(1100, marks=pytest.mark.long)])
def test_a_browser_draws_every_plot_without_a_word_in_its_console(page, width):
    seen = browser.opened(page, width)
    count = len(plots(page.read_text()))
    assert seen.console == []
    assert f'data-drawn="{count}"' in seen.page and seen.page.count("<canvas") == count


def test_of_an_estimate_alone_there_is_a_table(tmp_path, run_here):
    formats.write(tmp_path / "log.csv", motion(6.0))
    assert run_here("fit", "log.csv", "--save", "e.json")[0] == 0
    code, _ = run_here("report", "e.json", "-o", "e.html")
    text = (tmp_path / "e.html").read_text()
    assert code == 0 and "<h2>Parameters</h2>" in text and plots(text) == []
    code, out = run_here("report", "e.json", "--set", "J=2")
    assert code == 2 and "is not fitted again" in out
    for p in Estimate.load(tmp_path / "e.json").parameters:
        assert f"<td>{p.name}</td>" in text


def test_a_page_names_the_files_and_not_their_places(estimate, tmp_path):
    """A page that is passed on told where its writer keeps the recordings. Files of the same name keep their places."""
    friday, monday = (str(tmp_path / day) for day in ("friday.csv", "monday.csv"))
    found = replace(estimate, source=friday, message=f"{friday} is short.", notes=(f"{friday} is short.",))
    contents = Contents(found, earlier=replace(estimate, source=monday), held_out=[("", f"of {friday} too little")])
    text = report(contents)
    assert str(tmp_path) not in text and text.count("friday.csv") >= 3 and "The earlier one: monday.csv" in text
    other = replace(estimate, source=str(tmp_path / "other" / "friday.csv"))
    assert other.source in report(replace(contents, earlier=other))


def test_numbers_have_the_digits_of_their_intervals_and_ratios_no_unit(estimate):
    text = report_of_joints({"elbow": Contents(estimate)}, "log.csv")
    assert "estimated parameters, ± 1 sigma" in text and "k_1 3740 ± 750 Nm/rad, N 101.0 ± 2.0" in text
    assert "<td>± 1500</td><td>39 %</td><td>Nm/rad</td>" in text
    assert "<td>± 3.9</td><td>3.9 %</td><td></td>" in text and ">1</td>" not in text


def test_parts_of_joints_that_are_known_come_first_and_the_table_keeps_their_order(estimate):
    statuses = {"a": Status.NO_MOTION, "b": Status.POOR_FIT, "c": Status.CONVERGED, "d": Status.DISAGREE}
    text = report_of_joints({n: Contents(replace(estimate, status=one)) for n, one in statuses.items()}, "log.csv")
    assert re.findall(r'href="#joint-(\w)"', text) == ["a", "b", "c", "d"]
    assert re.findall(r'id="joint-(\w)"', text) == ["c", "d", "b", "a"]


@needs_browser
def test_tables_of_a_report_fit_a_phone(estimate, tmp_path):
    reason = (
        "the data narrow what was believed before only 1.3 times; it is hard to tell from tau_f (correlation -0.98)"
    )
    poor = replace(
        estimate, status=Status.POOR_FIT, message=f"{reason}. And more.", joint="shoulder_lift_joint",
        parameters=tuple(replace(p, reason=text) for p, text in zip(estimate.parameters, ("", reason), strict=True)),
    )  # fmt: skip
    page = tmp_path / "all.html"
    page.write_text(report_of_joints({"shoulder_lift_joint": Contents(poor), "elbow_joint": Contents(poor)}, "log.csv"))
    with browser.Tab(tmp_path, 390) as tab:
        tab.open(page.as_uri())
        cells = "[...document.querySelectorAll('.wide td, .wide .status')]"
        assert tab.value(f"{cells}.length") > 30
        assert tab.value(f"{cells}.every((e) => e.getBoundingClientRect().right <= 390)")
        begins = "[...document.querySelectorAll('.wide td:first-child')].map((e) => e.getBoundingClientRect().left)"
        assert len(set(tab.value(begins))) == 1, "every row begins at the left, also one after an empty reason"


@pytest.mark.long
def test_a_robots_log_gets_one_page_with_all_joints(tmp_path, run_here):
    """A table that leads to each joint; a joint that cannot be fitted is in it."""
    first, second = motion(8.0, seed=1), motion(8.0, seed=2)
    still = Recording(first.time, {n: np.zeros(len(first)) for n in first.channels})
    logged = {"timestamp": first.time}
    for k, record in enumerate((first, second, still)):
        logged |= {f"actual_q_{k}": record["link_position"], f"actual_current_{k}": record["torque"]}
    np.savetxt(
        tmp_path / "log.csv", np.array([*logged.values()]).T, delimiter=",", header=",".join(logged), comments=""
    )
    options = ("--set", "k_t=1", "--actuation", "current")
    code, out = run_here("report", "log.csv", *options, "-o", "all.html")
    text = (tmp_path / "all.html").read_text()
    assert code == 1 and "3 joints" in out and "no good estimate of elbow_joint" in out
    assert re.search(r"^  elbow_joint: ", out, re.M), "why"
    assert len(text) < 1e6 and "2 of 3 joints identified" in text
    links = re.findall(r'<a href="#([^"]+)">([^<]+)</a>', text)
    assert len(links) == 3 and all(f'<header id="{anchor}">' in text for anchor, _ in links)
    assert all(f"--joint {joint}" in text for _, joint in links), "how to repeat each"
    assert [p["title"] for p in plots(text)].count("link position [rad]") >= 2
    code, out = run_here("report", "log.csv", "--joint", links[0][1], *options, "-o", "one.html")
    assert code == 0 and "joints identified" not in (tmp_path / "one.html").read_text()


def test_samples_that_the_checks_doubt_are_in_a_table(tmp_path, run_here):
    record = motion(8.0)
    angle = record["link_position"].copy()
    angle[700] += 0.5
    formats.write(tmp_path / "log.csv", record.with_channels({"link_position": angle}))
    run_here("report", "log.csv")
    text = (tmp_path / "report.html").read_text()
    row = next(r for r in re.findall(r"<tr>(.*?)</tr>", text) if "<td>700</td>" in r)
    assert row.startswith("<td>link_position</td>") and f"<td>{angle[700]:.6g}</td>" in row


@pytest.mark.long
def test_a_poor_fit_still_gets_its_page_and_names_are_not_taken_for_html(tmp_path, run_here):
    record = motion(6.0)
    torque = np.random.default_rng(0).standard_normal(len(record))
    formats.write(
        tmp_path / "<b>&.csv", Recording(record.time, {"link_position": record["link_position"], "torque": torque})
    )
    code, out = run_here("report", "<b>&.csv")
    text = (tmp_path / "report.html").read_text()
    assert code == 1 and "poor_fit" in out
    assert "&lt;b&gt;&amp;.csv" in text and "<b>" not in text.split("<script")[0]


def test_what_cannot_be_written_is_said_before_the_fit(tmp_path, run_here):
    formats.write(tmp_path / "log.csv", motion(4.0))
    code, out = run_here("report", "log.csv", "-o", "no/such/report.html")
    assert code == 2 and "cannot be written" in out
    code, out = run_here("report", "log.csv", "--against", "no.json")
    assert code == 2 and "no.json" in out


def test_thinning_keeps_extremes_and_gaps():
    rng = np.random.default_rng(1)
    values = rng.standard_normal((2, 100_000))
    values[0, 31_234], values[:, 70_000:70_003] = 50.0, np.nan
    kept = series.thinned(values)
    assert len(kept) < 2.5 * series.MOST
    assert 31_234 in kept and np.nanmin(values[1, kept]) == np.nanmin(values[1])
    assert np.isnan(values[0, kept]).any()
