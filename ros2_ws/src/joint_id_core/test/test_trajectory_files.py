"""Trajectories as files: read again, and the URScript played by an interpreter of its own."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from joint_id_core.data.recording import Array
from joint_id_core.design.files import read_trajectory, write
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.urscript import SETTLE_S, urscript
from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import JOINT_NAMES


def arm_motion(names: tuple[str, ...] = JOINT_NAMES, duration: float = 2.0, rate: float = 125.0) -> Trajectory:
    rng = np.random.default_rng(5)
    cosines, sines = rng.normal(0.0, 0.1, (2, len(names), 2))
    home = rng.uniform(-1.0, 1.0, len(names))
    return FourierMotion(names, home, cosines, sines, np.array([0.5, 1.5]), duration, 0.5).sampled(rate)


class Robot:
    """Plays a URScript: what `servoj` is told, every period of it, and how the arm gets to the start."""

    def __init__(self, text: str, actual: list[float]) -> None:
        self.actual, self.asked, self.played, self.times, self.stopped = actual, 0, [list[float]()], [0.0], False
        self.played.clear()
        self.times.clear()
        self.variables: dict[str, list[float]] = {}
        self.settings: set[tuple[float, float]] = set()
        lines = [line for line in text.splitlines() if line and not line.startswith("#")]
        name = re.fullmatch(r"def (\w+)\(\):", lines[0])
        assert name and lines[-2:] == ["end", f"{name[1]}()"]
        self.time = 0.0
        for line in lines[1:-2]:
            assert line.startswith("  ") and not self.stopped
            self.run(line.strip())

    def run(self, line: str) -> None:
        if line == "stay = get_actual_joint_positions()":
            self.variables["stay"] = list(self.actual)
            return
        call = ast.parse(line.replace("=True", "=1"), mode="eval").body
        assert isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
        options = {key.arg: ast.literal_eval(key.value) for key in call.keywords}
        if call.func.id == "popup":
            assert options["blocking"] == 1
            self.asked += 1
        elif call.func.id == "stopj":
            assert 0.0 < ast.literal_eval(call.args[0]) <= 1.0
            self.stopped = True
        elif call.func.id == "movej":
            assert self.asked == 1 and options["v"] <= 0.25 and options["a"] <= 0.5
            self.played.append(self.numbers(call.args[0]))
            self.times.append(self.time)
        else:
            assert call.func.id == "servoj" and self.asked == 2
            self.settings.add((options["lookahead_time"], options["gain"]))
            self.time += options["t"]
            self.played.append(self.numbers(call.args[0]))
            self.times.append(self.time)

    def numbers(self, node: ast.expr) -> list[float]:
        assert isinstance(node, ast.List) and len(node.elts) == 6
        return [
            self.variables[one.value.id][ast.literal_eval(one.slice)]
            if isinstance(one, ast.Subscript) and isinstance(one.value, ast.Name)
            else float(ast.literal_eval(one))
            for one in node.elts
        ]


def close(one: Array, other: Array, tolerance: float) -> bool:
    return bool(np.abs(one - other).max() < tolerance)


@pytest.mark.parametrize("ending", ["csv", "yaml"])
def test_a_trajectory_read_again_is_the_same(tmp_path: Path, ending: str) -> None:
    trajectory, path = arm_motion(), tmp_path / f"motion.{ending}"
    write(trajectory, path)
    again = read_trajectory(path)
    assert again.names == trajectory.names
    for part in ("time", "position", "velocity", "acceleration"):
        assert close(getattr(again, part), getattr(trajectory, part), 1e-9)


def test_yaml_is_a_joint_trajectory(tmp_path: Path) -> None:
    trajectory, path = arm_motion(), tmp_path / "motion.yaml"
    write(trajectory, path)
    message = yaml.safe_load(path.read_text())
    assert set(message) == {"header", "joint_names", "points"} and message["joint_names"] == list(JOINT_NAMES)
    point = message["points"][130]
    assert point["time_from_start"] == {"sec": 1, "nanosec": 40_000_000} and point["effort"] == []
    assert all(isinstance(value, float) for values in message["points"] for value in values["velocities"])


def test_urscript_plays_the_trajectory() -> None:
    trajectory = arm_motion()
    robot = Robot(urscript(trajectory), [0.0] * 6)
    n = len(trajectory.time)
    played, times = np.array(robot.played), np.array(robot.times)
    assert close(times[:n], trajectory.time, 1e-9) and close(played[:n], trajectory.position, 1e-6)
    assert close(played[n:], trajectory.position[-1:], 1e-6) and times[-1] == pytest.approx(2.0 + SETTLE_S, abs=0.01)
    assert robot.stopped and robot.settings == {(0.1, 300)}


def test_urscript_leaves_other_joints_where_they_are() -> None:
    trajectory = arm_motion(("elbow_joint",))
    at = [0.1, -1.5, 1.0, 0.4, 0.5, 0.6]
    played = np.array(Robot(urscript(trajectory), at).played)
    assert close(played[: len(trajectory.time), 2:3], trajectory.position, 1e-6)
    others = [0, 1, 3, 4, 5]
    assert close(played[:, others], np.array(at)[others][None], 1e-12)


def test_urscript_says_what_it_does_and_asks_no_network() -> None:
    text = urscript(arm_motion(), ["Limits: those of a test."])
    head = [line for line in text.splitlines() if line.startswith("#")]
    assert text.splitlines()[: len(head)] == head
    said = " ".join(head)
    for words in (
        "for 2 s",
        "No collisions were checked",
        "Limits: those of a test.",
        "emergency stop",
        "rad/s^2",
        "slider is at 100 %",
    ):
        assert words in said
    assert not re.search(r"socket|rpc|modbus|http", text)
    assert "CB3" not in text and "CB3" in urscript(arm_motion(rate=500.0))


@pytest.mark.parametrize(
    ("trajectory", "text"),
    [
        (arm_motion(("joint_1",)), "joint_1 is no joint of a UR robot"),
        (arm_motion(("left_elbow_joint", "right_elbow_joint")), "are of two robots"),
    ],
)
def test_urscript_refuses_other_robots(trajectory: Trajectory, text: str) -> None:
    with pytest.raises(JointIdError, match=text):
        urscript(trajectory)


def test_urscript_refuses_a_period_that_the_controller_does_not_have() -> None:
    trajectory = arm_motion()
    odd = Trajectory(
        trajectory.names,
        trajectory.time * 0.9,
        trajectory.position,
        trajectory.velocity / 0.9,
        trajectory.acceleration / 0.81,
    )
    with pytest.raises(JointIdError, match="multiple of 2 ms"):
        urscript(odd)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("m.csv", "", "its first row must name time"),
        ("m.csv", "time,a_position\n0,1\n", "its first row must name time"),
        ("m.csv", "time,a_position,a_velocity,a_acceleration\n0,1,0,0\n1,x,0,0\n", "a value is no number"),
        ("m.csv", "time,a_position,a_velocity,a_acceleration\n0,1,0,0\n1,2\n", "another number of columns"),
        ("m.csv", "time,a_position,a_velocity,a_acceleration\n0,1,0,0\n1,2,0,0\n", "not the derivative"),
        ("m.yaml", "joint_names: [a]\npoints: [{positions: [0]}]", "no JointTrajectory"),
        ("m.yaml", "[", "cannot be read as YAML"),
        ("m.yaml", "3", "no JointTrajectory"),
        ("m.script", "", "read from .csv and .yaml"),
    ],
)
def test_bad_files(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(JointIdError, match=message):
        read_trajectory(tmp_path / name)


def test_other_endings_and_missing_files(tmp_path: Path) -> None:
    with pytest.raises(JointIdError, match="choose such an ending"):
        write(arm_motion(), tmp_path / "motion.txt")
    with pytest.raises(JointIdError, match="cannot be read"):
        read_trajectory(tmp_path / "none.csv")
