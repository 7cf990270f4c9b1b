"""The live page: what it shows, that it never grows, and whom its server answers."""

from __future__ import annotations

import http.client
import json
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.errors import JointIdError
from joint_id_core.estimators import fit
from joint_id_core.pages.live import MOST, Course, LiveView, Seen
from joint_id_core.pages.server import MARK, Feed, PageServer
from joint_id_core.results.estimate import Estimate

from .online_motion import MODEL, motion
from .served_page import JOINTS, ask, at, served


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    return fit(MODEL, motion())


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
    # The first of several curves is pale, as what is measured: the estimate keeps its colour.
    assert [s["name"] for s in tau_f["series"]] == ["baseline", "estimate"] and tau_f["data"][1] == [1.5] * 20
    assert tau_f["bands"] == [1]
    assert tau_f["data"][0] == list(range(-19, 1))
    view.take({"wrist": Seen(estimate)})  # the elbow has gone
    with pytest.raises(JointIdError, match="'elbow' is not published: wrist is"):
        view.plots("elbow", None)


def test_joints_stand_in_the_order_of_the_robot(estimate):
    view, names = LiveView(), ("shoulder", "elbow", "wrist")
    view.take({name: Seen(estimate) for name in (*sorted(names), "gripper")})
    assert [row["joint"] for row in view.joints(names)] == [*names, "gripper"]


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
