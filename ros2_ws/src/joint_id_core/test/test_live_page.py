"""The live page: what it shows, that it never grows, and whom its server answers."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.errors import JointIdError
from joint_id_core.estimators import fit
from joint_id_core.pages.live import ACTIONS, MOST, Course, LiveView, Seen, live_page
from joint_id_core.pages.report import prediction_plots
from joint_id_core.pages.server import MARK, Feed, PageServer
from joint_id_core.results.estimate import Estimate, Predictions

from . import browser
from .online_motion import MODEL, motion

needs_browser = pytest.mark.skipif(browser.PROGRAM is None, reason=browser.MISSING)
JOINTS = tuple(f"joint_{k}" for k in range(6))
RATE = 500  # Hz


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    return fit(MODEL, motion())


def at(estimate: Estimate, seconds: float) -> Estimate:
    """The same estimate, a little different, with a window that ends then."""
    rows = tuple(replace(p, value=p.value * (1.0 + 0.001 * np.sin(seconds))) for p in estimate.parameters)
    return replace(estimate, parameters=rows, end=seconds)


@given(st.integers(0, 5000))
def test_a_course_keeps_its_whole_span_in_few_points(count):
    course, one = Course(), Estimate("m", "e", None, "", ())
    for k in range(count):
        course.add(0.5 * k, one)
    time, _ = course.arrays()
    assert len(time) <= MOST and (count < 100 or time[0] < -0.5 * 0.9 * (0.5 * count))
    assert np.all(np.diff(time) > 0.0)
    course.add(-1.0, one)  # a new run
    assert len(course) == 1


def test_a_view_shows_every_joint_with_its_alarms_and_plots(estimate):
    view = LiveView()
    for k in range(20):
        alarms = ("J changed from 1 to 2",), ("tau_f drifts by 12 %",)
        view.take({"elbow": Seen(at(estimate, k), 0.0, *alarms, {"tau_f": 1.5}), "wrist": Seen(at(estimate, k))})
    elbow, wrist = view.joints()
    assert (elbow["joint"], wrist["joint"]) == ("elbow", "wrist")
    assert elbow["alarms"] == ["J changed from 1 to 2", "tau_f drifts by 12 %"] and not wrist["alarms"]
    assert [row[0] for row in elbow["parameters"]] == [p.name for p in estimate.parameters]
    found = view.plots("elbow", None)
    titles = [p["title"] for p in found["trends"]]
    assert titles == ["J [kg m^2]", "c [Nm s/rad]", "tau_f [Nm]", "tau_0 [Nm]"] and not found["fit"]
    tau_f = found["trends"][2]
    assert [s["name"] for s in tau_f["series"]] == ["estimate", "baseline"] and tau_f["data"][2] == [1.5] * 20
    assert tau_f["data"][0] == list(range(-19, 1))
    view.take({"wrist": Seen(estimate)})  # the elbow has gone
    with pytest.raises(JointIdError, match="'elbow' is not published: wrist is"):
        view.plots("elbow", None)


def window(seconds: float) -> Predictions:
    """Four seconds of 500 Hz."""
    time_ = np.arange(4 * RATE) / RATE
    measured = np.sin(3.0 * time_ + seconds)
    return Predictions(time_, {"link_position": measured}, {"link_position": measured + 1e-4})


@contextmanager
def served(estimate: Estimate, period: float = 0.5) -> Iterator[tuple[PageServer, list[str]]]:
    """A server of a live page of six joints, whose state changes every `period`, and the actions asked for."""
    view, feed, asked, ended, lock = LiveView(), Feed(), list[str](), threading.Event(), threading.Lock()

    def act(name: str) -> str:
        asked.append(name)
        if name == "reset":
            raise JointIdError("not now")
        return f"{name} is done"

    def go_on() -> None:
        begin = time.monotonic()
        while not ended.wait(period):
            now = time.monotonic() - begin
            with lock:
                view.take({joint: Seen(at(estimate, now)) for joint in JOINTS})
                nodes = [{"name": "/driver", "level": 1, "message": "late", "values": [["rate [Hz]", "499.9"]]}]
                feed.publish({"joints": view.joints(), "nodes": nodes, "silent": []})

    def plots(query: dict[str, str]) -> dict[str, object]:
        with lock:
            return {**view.plots(query.get("name", ""), window(time.monotonic())), "told": "of this moment"}

    actions = {f"/action/{name}": (lambda _, name=name: act(name)) for name in ACTIONS}
    pages: dict[str, Callable[..., str]] = {"/": lambda _: live_page("robot"), "/report": lambda q: q["joint"]}
    server = PageServer(0, pages, {"/joint": plots}, actions, feed)
    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        yield server, asked
    finally:
        ended.set()
        thread.join()
        server.close()


def ask(server: PageServer, path: str, method: str = "GET", **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10.0)
    connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_only_pages_of_this_computer_are_answered(estimate):
    with served(estimate, 0.05) as (server, asked):
        own = f"http://127.0.0.1:{server.port}"
        assert ask(server, "/")[0] == 200 and ask(server, "/", Origin=own)[0] == 200
        assert ask(server, "/", Host=f"localhost:{server.port}")[0] == 200
        for headers in ({"Host": "robot.example:80"}, {"Host": f"127.0.0.1.example:{server.port}"},
                        {"Origin": "http://robot.example"}, {"Origin": "null"}):  # fmt: skip
            assert ask(server, "/", **headers)[0] == 403
            assert ask(server, "/action/save", "POST", **{MARK: "1"}, **headers)[0] == 403
        assert ask(server, "/action/save", "POST")[0] == 403  # a form of another page cannot send the mark
        assert ask(server, "/action/save", "PUT")[0] == 501 and not asked
        assert ask(server, "/action/save", "POST", **{MARK: "1"}) == (200, '{"message":"save is done"}')
        assert ask(server, "/action/reset", "POST", **{MARK: "1"}) == (409, "not now")
        assert ask(server, "/action/else", "POST", **{MARK: "1"})[0] == 404 and ask(server, "/else")[0] == 404
        assert ask(server, "/action/save", "POST", **{MARK: "1", "Content_Length": "99999999"})[0] == 413
        assert asked == ["save", "reset"]
        assert ask(server, "/joint?name=elbow")[0] == 409


def test_a_reader_gets_the_newest_state_and_many_readers_are_refused(estimate):
    with served(estimate, 0.02) as (server, _):
        connections = []
        for _ in range(25):
            connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10.0)
            connection.request("GET", "/events")
            connections.append((connection, connection.getresponse()))
        assert [answer.status for _, answer in connections] == [200] * 20 + [503] * 5
        line = connections[0][1].readline()
        state = json.loads(line.decode().removeprefix("data: "))
        assert {row["joint"] for row in state["joints"]} <= set(JOINTS)
        for connection, answer in connections:
            answer.close()
            connection.close()
        end = time.monotonic() + 20.0  # their places are free again
        while ask_events(server) != 200:
            assert time.monotonic() < end


def ask_events(server: PageServer) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10.0)
    connection.request("GET", "/events")
    answer = connection.getresponse()
    answer.close()
    connection.close()
    return answer.status


def test_a_port_that_is_in_use_is_named(estimate):
    with served(estimate) as (server, _), pytest.raises(JointIdError, match=f"port {server.port} cannot be used"):
        PageServer(server.port, {}, {}, {}, Feed())


@needs_browser
@pytest.mark.parametrize("width", [1100, 390])
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
@pytest.mark.parametrize("width", [1100, 390])
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


def test_joints_stand_in_the_order_of_the_robot(estimate):
    view, names = LiveView(), ("shoulder", "elbow", "wrist")
    view.take({name: Seen(estimate) for name in (*sorted(names), "gripper")})
    assert [row["joint"] for row in view.joints(names)] == [*names, "gripper"]


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
