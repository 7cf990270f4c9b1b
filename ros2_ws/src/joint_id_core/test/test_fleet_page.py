"""The page of many robots: order of its rows, robots that go, the size of an update, and how a browser shows it."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import replace

import pytest

from joint_id_core.errors import JointIdError
from joint_id_core.pages.fleet import FleetView, fleet_page
from joint_id_core.pages.live import Seen
from joint_id_core.pages.server import Feed, PageServer
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Verdict
from joint_id_core.results.status import Status

from . import browser

JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
NAMES = ("J_m", "c_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq")
LARGEST = 40_000  # bytes of an update of 20 robots; 40 kB a second are nothing for a browser on the same computer


def seen(status: Status = Status.CONVERGED, **more: object) -> Seen:
    rows = tuple(ParameterEstimate(n, "Nm", 1.234, 0.01, Verdict.ESTIMATED, reason="the data show it") for n in NAMES)
    estimate = Estimate("harmonic_drive", "innovations", status, "Move the joint.", rows)
    return Seen(replace(estimate, free=NAMES), **more)


def robot(**statuses: Status) -> dict[str, Seen]:
    return {joint: seen(statuses.get(joint, Status.CONVERGED)) for joint in JOINTS}


def test_what_changed_last_stands_first():
    view = FleetView()
    for k in range(3):
        view.take(f"ur_{k}", robot(), float(k))
    assert [row[0] for row in view.state(3.0)["joints"][::6]] == ["ur_2", "ur_1", "ur_0"]
    view.take("ur_0", robot(joint_4=Status.POOR_FIT), 10.0)  # the others of this robot are no news
    rows = view.state(12.0)["joints"]
    assert rows[0][:4] == ["ur_0", "joint_4", "poor_fit", ""] and rows[0][6] == 2
    assert [row[0] for row in rows[1::6]] == ["ur_2", "ur_1", "ur_0"]
    alarmed = {**robot(), "joint_2": seen(drifts=("tau_fm drifts by 12 %",))}
    view.take("ur_1", alarmed, 20.0)
    assert view.state(21.0)["joints"][0][1:2] == ["joint_2"]
    assert "tau_fm drifts" in view.state(21.0)["joints"][0][7]
    view.take("ur_1", alarmed, 30.0)  # the same once more is no news
    assert view.state(31.0)["joints"][0][6] == 11


def test_a_robot_that_vanishes_is_shown_as_gone_until_it_is_back():
    view = FleetView()
    view.take("a", robot(), 0.0)
    view.take("b", robot(), 1.0)
    view.nodes("a", 1, "filter: late")
    view.there("a", False, 5.0)
    view.there("a", False, 6.0)
    a, b = view.state(9.0)["robots"]
    assert a[:2] == ["a", True] and a[-1] == "gone for 4 s" and b[:2] == ["b", False]
    rows = view.state(9.0)["joints"]
    assert {row[2] for row in rows[:6]} == {"gone"} and {row[0] for row in rows[:6]} == {"a"}
    assert {row[5] for row in rows[:6]} == {9.0}  # ages go on
    view.there("a", True, 10.0)
    a, _ = view.state(11.0)["robots"]
    assert a[1] is False and a[-1] == "filter: late"
    assert view.state(11.0)["joints"][0][2] == "converged"


def test_one_joint_is_told_in_full_and_an_unknown_one_is_refused():
    view = FleetView()
    view.take("a", robot(joint_1=Status.NO_MOTION), 0.0)
    found = view.joint("a", "joint_1")
    assert found["message"] == "Move the joint." and [row[0] for row in found["parameters"]] == list(NAMES)
    for unknown in (("a", "joint_9"), ("b", "joint_1")):
        with pytest.raises(JointIdError, match="is not published"):
            view.joint(*unknown)


def twenty() -> FleetView:
    view = FleetView()
    for k in range(20):
        wrong = {"joint_3": Status.POOR_FIT} if k == 7 else {"joint_5": Status.NO_MOTION} if k % 5 == 0 else {}
        view.take(f"cell_{k // 4}/ur_{k % 4}", robot(**wrong), float(k))
    view.there("cell_4/ur_3", False, 30.0)
    view.carries("cell_0/ur_1", "tool0 carries 1.52 ± 0.03 kg", 30.0)
    return view


def test_an_update_of_twenty_robots_is_small():
    state = twenty().state(40.0)
    assert len(state["joints"]) == 120 and len(json.dumps(state, separators=(",", ":"))) < LARGEST


@pytest.mark.skipif(browser.PROGRAM is None, reason=browser.MISSING)
@pytest.mark.parametrize("width", [1100, pytest.param(390, marks=pytest.mark.long)])
def test_a_browser_shows_twenty_robots_filters_and_tells_of_one_joint(tmp_path, width):
    view, feed, ended = twenty(), Feed(), threading.Event()
    answers = {"/joint": lambda query: view.joint(query["robot"], query["joint"])}
    server = PageServer(0, {"/": lambda _: fleet_page("all <robots>")}, answers, {}, feed)

    def go_on() -> None:
        begun = time.monotonic()
        while not ended.wait(0.2):
            feed.publish(view.state(40.0 + time.monotonic() - begun))

    thread = threading.Thread(target=go_on)
    thread.start()
    try:
        with browser.Tab(tmp_path, width) as tab:
            tab.open(server.address)
            tab.until("document.querySelectorAll('#joints tbody tr').length === 120")
            assert tab.value("document.querySelectorAll('#robots tbody tr').length") == 20
            told = tab.value("document.querySelector('#told').innerText")
            assert told.startswith("20 robots (1 gone), 120 joints: 109 converged, 10 at rest or gone")
            assert "1 wrong" in told
            assert tab.value("document.querySelector('#robots').innerText").count("1.52 ± 0.03 kg") == 1
            assert tab.value("document.documentElement.scrollWidth") <= width
            first = "document.querySelector('#joints tbody tr').innerText"
            assert tab.value(first).startswith("cell_4/ur_3")  # what has just gone
            tab.value("(e => { e.value = 'poor'; e.oninput(); })(document.querySelector('#wanted'))")
            tab.until("document.querySelectorAll('#joints tbody tr').length === 1")
            tab.value("document.querySelector('#joints tbody tr').click()")
            tab.until("document.querySelector('#says').innerText.startsWith('cell_1/ur_3, joint_3: ')")
            tab.until("document.querySelectorAll('#parameters tbody tr').length === 9")
            tab.picture(tmp_path / "fleet.png")
            assert not tab.console
    finally:
        ended.set()
        thread.join()
        server.close()
