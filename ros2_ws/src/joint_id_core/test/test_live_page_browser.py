"""The live page in a browser: what is drawn, what is silent, and that it does not grow."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from joint_id_core.estimators import fit
from joint_id_core.pages.live import LiveView, Seen, live_page
from joint_id_core.pages.report import prediction_plots
from joint_id_core.pages.server import Feed, PageServer
from joint_id_core.results.estimate import Estimate, Status

from . import browser
from .online_motion import MODEL, motion
from .quick import first_quick
from .served_page import RATE, served, window

needs_browser = pytest.mark.skipif(browser.PROGRAM is None, reason=browser.MISSING)


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    return fit(MODEL, motion())


@needs_browser
@pytest.mark.parametrize("width", first_quick([1100, 390]))
def test_a_browser_draws_the_page_goes_to_another_joint_and_presses_buttons(estimate, tmp_path, width):
    with served(estimate) as (server, asked), browser.Tab(tmp_path, width) as tab:
        tab.open(server.address)
        tab.until("document.querySelectorAll('#fit canvas').length === 3")
        tab.until("document.querySelectorAll('#trends canvas').length === 4")
        assert tab.value("document.querySelector('#alarms').innerText") == "/driver: late"
        assert tab.value("document.querySelectorAll('#joints tbody tr').length") == 6
        assert tab.value("document.documentElement.scrollWidth") <= width
        tab.value("document.querySelectorAll('#joints tbody tr')[4].click()")
        tab.until("document.querySelector('#says').innerText.startsWith('joint_4: ')")
        assert tab.value("document.querySelector('#report').href").endswith("report?joint=joint_4")
        tab.value("document.querySelector('[data-action=save]').click()")
        tab.until("document.querySelector('#answer').innerText === 'save is done'")
        assert asked == ["save"]
        assert tab.value("[...document.querySelectorAll('canvas')].every((c) => c.width > 100)")
        tab.picture(tmp_path / "page.png")
        assert not tab.console
        server.close()
        tab.until("document.querySelector('#link').innerText === 'not connected'")


@needs_browser
def test_ticks_are_short_and_nothing_is_left_of_joints_that_are_gone(estimate, tmp_path):
    joint = LiveView._row("elbow", Seen(estimate))
    node = {"name": "/identifier", "level": 0, "message": "ok", "values": [["joints that wait", ""]]}
    feed = Feed()
    plots = {"trends": [], "fit": [], "told": ""}
    server = PageServer(0, {"/": lambda _: live_page("robot")}, {"/joint": lambda _: plots}, {}, feed)
    try:
        with browser.Tab(tmp_path) as tab:
            tab.open(server.address)
            told = [tab.value(f"jointId.short({v})") for v in ("602000000", "-1e12", "12345.6", "0.0000123", "0")]
            assert told == ["6.02e+8", "-1e+12", "12345.6", "1.23e-5", "0"]
            feed.publish({"joints": [joint], "nodes": [node], "silent": []})
            tab.until("!!document.querySelector('#parameters table')")
            assert not tab.value("document.querySelector('#choice').hidden")
            drift = "tau_f is 39 % above its baseline"
            warned = {**node, "level": 1, "message": f"elbow: {drift}; a fit is late"}
            feed.publish({"joints": [{**joint, "alarms": [drift]}], "nodes": [warned], "silent": []})
            tab.until(f"document.querySelector('#alarms').innerText === 'elbow: {drift}\\n/identifier: a fit is late'")
            feed.publish({"joints": [], "nodes": [node], "silent": []})
            tab.until("!document.querySelector('#parameters table')")
            assert tab.value("document.querySelector('#choice').hidden")
            assert tab.value("document.querySelector('#told').innerText").startswith("No estimate yet: it takes")
            assert "joints that wait: none" in tab.value("document.querySelector('#nodes').innerText")
            feed.publish({"joints": [], "nodes": [], "silent": []})
            tab.until("document.querySelector('#told').innerText.includes('no identifier is running')")
            assert not tab.console
    finally:
        server.close()


@needs_browser
def test_after_a_reset_no_plot_stays_and_the_chosen_joint_is_shown_again(estimate, tmp_path):
    view, feed = LiveView(), Feed()
    view.take({name: Seen(estimate) for name in ("elbow", "wrist")})
    rows = view.joints()
    plots = {"trends": [], "fit": list(prediction_plots(window(0.0), 4.0)), "told": "of this moment"}
    server = PageServer(0, {"/": lambda _: live_page("robot")}, {"/joint": lambda _: plots}, {}, feed)
    try:
        with browser.Tab(tmp_path) as tab:
            tab.open(server.address)
            feed.publish({"joints": rows, "nodes": [], "silent": []})
            tab.until("document.querySelectorAll('#joints tbody tr').length === 2")
            tab.value("document.querySelectorAll('#joints tbody tr')[1].click()")
            tab.until("document.querySelectorAll('#fit canvas').length === 3")
            feed.publish({"joints": [], "nodes": [], "silent": []})
            tab.until("!document.querySelector('canvas') && !document.querySelector('#window').innerText")
            says = "document.querySelector('#says').innerText"
            for there in (rows[:1], rows):  # one after the other
                feed.publish({"joints": there, "nodes": [], "silent": []})
                tab.until(f"{says}.startsWith('{there[-1]['joint']}: ')")
            assert tab.value("document.querySelector('#report').href").endswith("report?joint=wrist")
            assert not tab.console
    finally:
        server.close()


@contextmanager
def shown(folder: Path, width: int, state: dict[str, object], found: dict[str, object]) -> Iterator[browser.Tab]:
    """A browser with a page of this state, whose joints have these plots."""
    feed = Feed()
    server = PageServer(0, {"/": lambda _: live_page("robot")}, {"/joint": lambda _: found}, {}, feed)
    try:
        with browser.Tab(folder, width) as tab:
            tab.open(server.address)
            feed.publish(state)
            tab.until("!!document.querySelector('#nodes table')")
            yield tab
            assert not tab.console
    finally:
        server.close()


NOTHING: dict[str, object] = {"trends": [], "fit": [], "told": ""}
GREY = "rgb(107, 118, 130)"


@needs_browser
def test_a_joint_that_only_waits_for_motion_is_grey_as_on_the_page_of_a_fleet(estimate, tmp_path):
    view = LiveView()
    looks = {Status.CONVERGED: "rgb(44, 122, 75)", Status.DISAGREE: "rgb(138, 97, 0)", Status.NO_MOTION: GREY,
             Status.TOO_SHORT: GREY, Status.POOR_FIT: "rgb(163, 59, 42)"}  # fmt: skip
    view.take({str(k): Seen(replace(estimate, status=s, temperature=28.0)) for k, s in enumerate(looks)})
    with shown(tmp_path, 1100, {"joints": view.joints(), "nodes": [], "silent": []}, NOTHING) as tab:
        marks = "[...document.querySelectorAll('#joints .status')].map((m) => getComputedStyle(m).backgroundColor)"
        assert tab.value(marks) == list(looks.values())
        assert tab.value("document.querySelector('#joints tbody tr').cells[3].innerText") == "28.0"


@needs_browser
def test_what_is_silent_is_told_in_the_head_and_no_mark_stays_green(estimate, tmp_path):
    view = LiveView()
    view.take({"elbow": Seen(estimate, 0.5)})
    silent = ["No samples for 26 s", "/identifier is silent for 11 s"]
    state = {"joints": view.joints(waited_s=11.2), "nodes": [], "silent": silent}
    with shown(tmp_path, 1100, state, NOTHING) as tab:
        link = "document.querySelector('#link')"
        assert tab.value(f"{link}.innerText") == "silent" and "good" not in tab.value(f"{link}.className")
        told = tab.value("document.querySelector('#told').innerText")
        assert told == f"{'; '.join(silent)}: what stands here is from before."
        row = [tab.value(f"document.querySelectorAll('#joints td')[{k}].innerText") for k in range(3)]
        assert row == ["elbow", "converged", "11.7"]
        assert tab.value("getComputedStyle(document.querySelector('#joints .status')).backgroundColor") == GREY
        # A server that says nothing any more: its node was stopped.
        tab.until(f"{link}.innerText === 'not connected'")
        assert tab.value("document.querySelector('#told').innerText").startswith(
            "The node of this page does not answer"
        )


@needs_browser
@pytest.mark.parametrize("width", first_quick([390, 1100]))
def test_long_names_and_reasons_are_wrapped_within_the_page(estimate, tmp_path, width):
    reason = "the data narrow what was believed before only 1.3 times: it is hard to tell from J (correlation -0.98)"
    rows = tuple(replace(p, reason=reason) for p in estimate.parameters)
    view, alarm = LiveView(), "shoulder_lift_joint: tau_f is 26.4 ± 0.17 % above its baseline, confidence above 0.9999"
    view.take({f"shoulder_{side}_joint": Seen(replace(estimate, parameters=rows)) for side in ("pan", "lift")})
    node = {"name": "/identifier", "level": 1, "message": f"{alarm}; {alarm}", "values": [["rate [Hz]", "499.9"]] * 9}
    with shown(tmp_path, width, {"joints": view.joints(), "nodes": [node], "silent": []}, NOTHING) as tab:
        for place in ("joints", "parameters", "nodes"):
            tab.until(f"document.querySelectorAll('#{place} td').length > 1")
            box = f"document.querySelector('#{place}')"
            assert tab.value(f"{box}.scrollWidth") <= tab.value(f"{box}.clientWidth"), place
            cells = f"[...document.querySelectorAll('#{place} td')]"
            assert tab.value(f"{cells}.every((e) => e.getBoundingClientRect().right <= {width})"), place
        assert tab.value("!document.querySelector('#choose').hidden"), "there is a choice"


@needs_browser
def test_a_legend_names_its_curves_and_a_spectrum_ends_with_its_data(estimate, tmp_path):
    view = LiveView()
    view.take({"elbow": Seen(estimate)})
    found = {"trends": [], "fit": list(prediction_plots(window(0.0), 4.0)), "told": ""}
    with shown(tmp_path, 1100, {"joints": view.joints(), "nodes": [], "silent": []}, found) as tab:
        assert tab.value("document.querySelector('#choose').hidden"), "one joint is no choice"
        tab.until("document.querySelectorAll('#fit canvas').length === 3")
        legend = "document.querySelector('#fit .u-legend')"
        assert tab.value(f"{legend}.innerText").split() in (["measuredpredicted"], ["measured", "predicted"])
        assert tab.value(f"[...{legend}.querySelectorAll('th')].every((e) => "
                         "getComputedStyle(e, '::after').content === 'none')")  # fmt: skip
        drawn = """(async () => {
            const [figures, Plot] = [document.querySelectorAll('#fit figure'), uPlot];
            jointId.clear();
            const charts = [];
            uPlot = function (...given) { const chart = new Plot(...given); charts.push(chart); return chart; };
            PLOTS.forEach((plot, k) => jointId.draw(figures[k], plot));
            await new Promise((go) => setTimeout(go, 100));
            return charts.map((chart) => chart.scales.x.max);
        })()"""
        ends = tab.value(drawn.replace("PLOTS", json.dumps(found["fit"])))
        assert ends[2] == RATE / 2


@needs_browser
@pytest.mark.long
def test_six_joints_at_500_hz_for_two_minutes_leave_the_page_as_large_as_it_was(estimate, tmp_path):
    with served(estimate, 0.1) as (server, _), browser.Tab(tmp_path) as tab:
        tab.open(server.address)
        tab.until("document.querySelectorAll('canvas').length === 7")
        tab.until("Number(document.body.dataset.states) > 100")
        before, nodes = tab.heap(), tab.value("document.querySelectorAll('*').length")
        begun = time.monotonic()
        while time.monotonic() < begun + 120.0:
            time.sleep(1.0)
            tab.value(f"document.querySelectorAll('#joints tbody tr')[{int(time.monotonic()) % 6}].click()")
        tab.until("document.querySelectorAll('canvas').length === 7")
        # The courses grow to at most 600 points; what is drawn of the others is gone.
        assert tab.heap() < 1.5 * before + 2e6
        assert abs(tab.value("document.querySelectorAll('*').length") - nodes) < 20
        assert not tab.console
