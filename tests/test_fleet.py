"""Many robots in one graph: nothing crosses, a robot with a fault leaves the others alone, all stand on one page."""

from __future__ import annotations

import http.client
import json
import os
import signal
import time
from pathlib import Path

import pytest
import yaml

from joint_id_msgs.msg import JointEstimate, JointParams
from joint_id_ros.qos import LATEST

# Least squares in place of the default estimator: what is tested is where estimates go, not what they are.
COMMON = {"params_file": "ur3e", "estimator": "regression", "hop_s": 1.0, "window_s": 2.0, "rate": 125.0}


def written(tmp_path, robots) -> str:
    path = tmp_path / "robots.yaml"
    path.write_text(yaml.safe_dump({"all": COMMON, "robots": robots}))
    return str(path)


def entry(name, port, **more):
    return {"name": name, "robot_ip": "127.0.0.1", "port": port, **more}


@pytest.fixture
def two(robot):
    """Two robots; of one only the first joint moves, of the other only the second."""
    return {"cell_1/ur_a": robot("--moving", "0"), "cell_1/ur_b": robot("--moving", "1")}


def moving(messages) -> set[str]:
    """Joints of the newest message that moved."""
    resting = (JointEstimate.NO_MOTION, JointEstimate.TOO_SHORT)
    return {j.joint for j in messages[-1].joints if j.status not in resting} if messages else set()


class Page:
    """The states of a live page."""

    def __init__(self, text: str) -> None:
        self._port = int(text.split("http://127.0.0.1:")[1].split("/")[0])
        self._events = self._ask("/events")

    def _ask(self, path: str) -> http.client.HTTPResponse:
        connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=30.0)
        connection.request("GET", path)
        return connection.getresponse()

    def until(self, wanted):
        """The first state for which `wanted` holds."""
        end, state = time.monotonic() + 120.0, {}
        while time.monotonic() < end:
            line = self._events.readline().decode()
            if line.startswith("data: ") and (state := json.loads(line[6:])) and wanted(state):
                return state
        raise AssertionError(f"the page never said so; at last: {state}")

    def joint(self, robot: str, joint: str):
        """What it tells of one joint."""
        return json.loads(self._ask(f"/joint?robot={robot}&joint={joint}").read())


def test_two_robots_side_by_side_do_not_cross_and_faulty_ones_leave_them_alone(start, probe, two, tmp_path):
    good = [entry(name, one.port) for name, one in two.items()]
    faulty = [entry("cell_2/nobody", 1), entry("cell_2/typo", 2, hopp_s=1), entry("cell_2/odd", 3, order=99)]
    found = {name: probe.collect(JointParams, f"/{name}/joint_params", LATEST) for name in two}
    fleet, watch = start("fleet", robots=written(tmp_path, [*good, *faulty])), start("watch_fleet", port=0)
    probe.until(lambda: moving(found["cell_1/ur_a"]) == {"shoulder_pan_joint"}, "estimates of the first robot")
    probe.until(lambda: moving(found["cell_1/ur_b"]) == {"shoulder_lift_joint"}, "estimates of the second robot")
    for name in two:
        for topic in ("link_states", "motor_states", "joint_samples", "joint_params"):
            probe.until(lambda t=f"/{name}/{topic}": probe.count_publishers(t), f"a publisher of {topic}")
            assert probe.count_publishers(f"/{name}/{topic}") == 1 and probe.count_publishers(f"/{topic}") == 0
        assert all(not moving([m]) - moving(found[name]) for m in found[name])  # never the joint of the other one
    probe.until(lambda: probe.told("cell_2/nobody/driver", "127.0.0.1:1"), "word of the robot that is not there")
    probe.until(lambda: probe.told("fleet", "cell_2/typo is left out"), "word of the robot with a fault")
    status = probe.told("fleet", "cell_2/typo is left out")
    assert status.level == b"\x02" and "did you mean hop_s?" in status.message
    assert "cell_2/odd is left out" in status.message and "order" in status.message
    probe.until(lambda: probe.told("cell_1/ur_a/filter", ""), "the state of the first robot's filter")
    assert {s.hardware_id for s in probe.diagnostics if s.name == "/cell_1/ur_a/filter"} == {"cell_1/ur_a"}

    probe.until(lambda: "the page is at" in watch.text, "the page")
    page = Page(watch.text)
    state = page.until(lambda s: len(s.get("joints", ())) == 12)
    assert {row[0] for row in state["robots"]} == set(two)
    assert [row[0] for row in page.joint("cell_1/ur_b", "shoulder_lift_joint")["parameters"]][:2] == ["J_m", "c_m"]
    page.until(lambda s: {row[0]: row[7] for row in s["robots"]}.keys() == set(two))
    fleet.signal(signal.SIGKILL)  # says nothing any more
    state = page.until(lambda s: all(row[1] for row in s["robots"]))
    assert {row[2] for row in state["joints"]} == {"gone"} and "gone for" in state["robots"][0][-1]


@pytest.mark.long
def test_processes_share_the_robots_and_one_that_is_killed_is_started_again(start, probe, two, tmp_path):
    found = {name: probe.collect(JointParams, f"/{name}/joint_params", LATEST) for name in two}
    path = written(tmp_path, [entry(name, one.port) for name, one in two.items()])
    fleet = start("fleet", robots=path, processes=2)
    probe.until(lambda: all(map(moving, found.values())), "estimates of both")
    probe.until(lambda: probe.told("fleet_1", "cell_1/ur_a") and probe.told("fleet_2", "cell_1/ur_b"), "both parts")
    assert not probe.told("fleet_1", "cell_1/ur_b")
    (child,) = children(fleet, "part:=2")
    os.kill(child, signal.SIGKILL)
    found["cell_1/ur_a"].clear()
    count = len(found["cell_1/ur_b"])
    probe.until(lambda: probe.told("fleet", "process 2 ended"), "word of the process")
    probe.until(lambda: len(found["cell_1/ur_b"]) > count + 1, "estimates of the robot whose process was killed")
    assert found["cell_1/ur_a"]  # went on meanwhile
    fleet.signal(signal.SIGTERM)
    assert fleet.wait() == 0 and not children(fleet, "part:=")


def test_processes_end_with_the_one_that_started_them_even_if_it_is_killed(start, probe, tmp_path):
    fleet = start("fleet", robots=written(tmp_path, [entry("a", 1), entry("b", 2)]), processes=2)
    probe.until(lambda: probe.told("fleet_1", "a") and probe.told("fleet_2", "b"), "both parts")
    begun = children(fleet, "part:=")
    assert len(begun) == 2
    fleet.signal(signal.SIGKILL)
    probe.until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in begun), "their end")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robots: [{name: a}, {name: a}]", "two robots have the name a: give each its own"),
        ("robots: []", 'write "robots:"'),
    ],
)
def test_a_file_with_an_error_ends_the_fleet_with_one_line(start, tmp_path, text, said):
    path = tmp_path / "robots.yaml"
    path.write_text(text)
    fleet = start("fleet", robots=str(path))
    assert fleet.wait() == 2 and said in fleet.text and "Traceback" not in fleet.text


def test_the_page_of_one_robot_shows_the_nodes_of_its_namespace_alone(start, probe):
    ns = ("-r", "__ns:=/left")
    watch = start("watch", *ns, port=0)
    start("filter", *ns)
    start("filter", "-r", "__ns:=/left_over")  # a name that begins in the same way
    probe.until(lambda: "the page is at" in watch.text, "the page")
    probe.until(lambda: probe.told("left_over/filter", ""), "the other filter")
    page = Page(watch.text)
    state = page.until(lambda s: len(s.get("nodes", ())) == 2)
    for _ in range(4):
        assert {node["name"] for node in state["nodes"]} == {"/left/watch", "/left/filter"}
        state = page.until(bool)


def children(process, argument: str) -> list[int]:
    """Processes that another one has started with an argument."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == process.pid and argument in (folder / "cmdline").read_text():
                found.append(int(folder.name))
        except OSError:
            continue  # it has ended meanwhile
    return found
