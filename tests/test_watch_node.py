"""The live page over the real graph: estimates, the fit of the newest window, services by buttons, and a clean end."""

from __future__ import annotations

import http.client
import json
import signal
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

CONVERGED_S = 120.0


@pytest.fixture
def graph(start, probe):
    """A simulated joint that is identified, and the port of its live page."""
    identifier, filter_ = start("identifier", window_s=2.0, hop_s=0.5), start("filter")
    watch = start("watch", port=0)
    probe.until(lambda: "the page is at" in watch.text, "the live page")
    probe.until(lambda: probe.count_subscribers("joint_samples") == 2, "identifier and page")
    sim = start("sim", wait_subscribers=1, duration=120.0)
    port = int(watch.text.split("http://127.0.0.1:")[1].split("/")[0])
    return {"watch": watch, "identifier": identifier, "filter": filter_, "sim": sim, "port": port}


def ask(port, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


class Events:
    """States of the page, as its script gets them."""

    def __init__(self, port):
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)
        self._connection.request("GET", "/events")
        self._answer = self._connection.getresponse()

    def until(self, wanted):
        """The first state for which `wanted` gives something, and what that is."""
        end = time.monotonic() + CONVERGED_S
        while time.monotonic() < end:
            line = self._answer.readline().decode()
            if line.startswith("data: ") and (state := json.loads(line[6:])) and (found := wanted(state)):
                return found
        raise AssertionError(f"not within {CONVERGED_S} s")


def test_the_page_shows_the_graph_and_its_buttons_reach_the_identifier(graph):
    port = graph["port"]
    events = Events(port)
    joint = events.until(lambda s: next((j for j in s["joints"] if j["good"]), None))
    assert joint["model"] == "electromechanical" and {"k_1", "R"} <= {row[0] for row in joint["parameters"]}
    assert max(joint["nrmse"].values()) < 0.1
    nodes = events.until(lambda s: s["nodes"] if len(s["nodes"]) >= 4 else None)
    assert {"/sim", "/filter", "/identifier", "/watch"} <= {n["name"] for n in nodes}
    assert any(key == "rate [Hz]" for n in nodes if n["name"] == "/filter" for key, _ in n["values"])

    def counted(state):
        return any(dict(n["values"]).get("received", "0") != "0" for n in state["nodes"] if n["name"] == "/watch")

    assert events.until(counted), "the page's own node counts samples, too"
    end = time.monotonic() + CONVERGED_S  # the options of the identifier come a little later
    while not (found := json.loads(ask(port, f"/joint?name={joint['joint']}")[1]))["fit"] or not found["trends"]:
        assert time.monotonic() < end, found["told"]
        time.sleep(0.2)
    first = found["fit"][0]
    assert [s["name"] for s in first["series"]] == ["measured", "predicted"]
    pairs = [(m, p) for m, p in zip(*first["data"][1:3], strict=True) if m is not None and p is not None]
    spread = max(m for m, _ in pairs) - min(m for m, _ in pairs)
    assert len(pairs) > 500 and max(abs(m - p) for m, p in pairs) < 0.1 * spread

    status, page = ask(port, f"/report?joint={joint['joint']}")
    assert status == 200 and "Measured and predicted" in page and "k_1" in page
    status, told = ask(port, "/action/set_baseline", "POST", **{"X-Joint-Id": "1"})
    assert status == 200 and "baseline of" in told
    status, told = ask(port, "/action/save", "POST", **{"X-Joint-Id": "1"})
    assert status == 409 and "state_file" in told  # none was given
    assert ask(port, "/action/reset", "POST", **{"X-Joint-Id": "1"})[0] == 200
    assert ask(port, "/", Host="robot.example")[0] == 403

    assert not events.until(lambda s: s)["silent"]
    graph["identifier"].signal(signal.SIGINT)
    assert graph["identifier"].wait() == 0
    events.until(lambda s: any("/identifier is silent for" in text for text in s["silent"]))
    graph["sim"].signal(signal.SIGINT)
    events.until(lambda s: any("No samples for" in text for text in s["silent"]))
    status, told = ask(port, "/action/reset", "POST", **{"X-Joint-Id": "1"})
    assert status == 409 and "is the identifier identifier running?" in told
    graph["watch"].signal(signal.SIGINT)  # while a page is open
    assert graph["watch"].wait() == 0
    assert "Traceback" not in graph["watch"].text


def test_diagnostics_of_many_nodes_are_shown_when_they_come(start, probe):
    watch = start("watch", port=0)
    probe.until(lambda: "the page is at" in watch.text, "the live page")
    publisher = probe.create_publisher(DiagnosticArray, "/diagnostics", 10)
    probe.until(lambda: publisher.get_subscription_count() == 2, "the page")
    count = 0
    for count in range(200):  # 40 a second
        status = DiagnosticStatus(name=f"/node_{count % 10}", message=str(count))
        publisher.publish(DiagnosticArray(status=[status]))
        probe.spin(0.025)
    sent = time.monotonic()
    port = int(watch.text.split("http://127.0.0.1:")[1].split("/")[0])
    Events(port).until(lambda s: any(n["message"] == str(count) for n in s["nodes"]))
    assert time.monotonic() - sent < 1.5
