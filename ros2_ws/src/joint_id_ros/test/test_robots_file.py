"""The file of a fleet: what it says of each robot, and what is said of a file with an error."""

from __future__ import annotations

from pathlib import Path

import pytest

from joint_id_core.errors import JointIdError
from joint_id_ros.robots_file import read_robots

GOOD = """
all: {params_file: ur3e, hop_s: 0.5, state_file: "{robot}.json"}
robots:
  - {name: cell_1/ur_a, robot_ip: 192.168.0.10}
  - {name: /cell_1/ur_b/, robot_ip: 192.168.0.11, params_file: ur5e, hop_s: 2, joints: [elbow_joint, wrist_1_joint]}
  - {name: welder, robot_ip: welder.local, launch: arm, urdf: welder.urdf}
"""


def robots(tmp_path: Path, text: str):
    path = tmp_path / "robots.yaml"
    path.write_text(text)
    return read_robots(path)


def problem(tmp_path: Path, entry: str) -> str:
    """What is wrong with the second robot of a file whose first one is all right."""
    text = f"robots:\n  - {{name: a, robot_ip: x, params_file: ur3e, state_file: a.json}}\n  - {{name: b, {entry}}}\n"
    first, second = robots(tmp_path, text)
    assert not first.problem and first.starts
    assert not second.starts
    return second.problem


def test_a_robot_has_the_arguments_of_all_and_its_own(tmp_path):
    a, b, welder = robots(tmp_path, GOOD)
    assert [one.name for one in (a, b, welder)] == ["cell_1/ur_a", "cell_1/ur_b", "welder"]
    assert not any(one.problem for one in (a, b, welder))
    nodes = {start.name: start for start in a.starts}
    assert list(nodes) == ["driver", "filter", "identifier"]
    assert nodes["driver"].given == {"robot_ip": "192.168.0.10"}
    assert nodes["identifier"].given == {"hop_s": 0.5, "state_file": "cell_1_ur_a.json"}
    assert nodes["identifier"].files[0].endswith("ur3e.yaml")
    identifier = next(start for start in b.starts if start.name == "identifier")
    assert identifier.given == {
        "hop_s": 2.0, "state_file": "cell_1_ur_b.json", "joints": ["elbow_joint", "wrist_1_joint"],
    }  # fmt: skip
    assert [start.name for start in welder.starts] == ["driver", "filter", "arm_identifier"]


def test_the_file_on_the_page_of_the_node_is_right(tmp_path):
    page = Path(__file__).resolve().parents[4] / "docs/nodes/fleet.md"
    if not page.exists():
        pytest.skip("the docs are not beside the package")
    found = robots(tmp_path, page.read_text().split("```text\n")[1].split("```")[0])
    assert [(one.name, one.problem) for one in found] == [
        ("cell_1/ur_a", ""),
        ("cell_1/ur_b", ""),
        ("cell_2/welder", ""),
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("robots: [", "expected the node content"),
        ("robots: {}", "below it a list"),
        ("- name: a", 'write "robots:"'),
        ("robot: []\nrobots: [{name: a}]", "robot: a file of robots has only the parts all and robots"),
        ("all: [1]\nrobots: [{name: a}]", "all: write arguments of every robot"),
        (
            "all: {hopp_s: 1}\nrobots: [{name: a}]",
            "all: hopp_s is no argument of robot.launch.py or arm.launch.py: did",
        ),
        ("robots: [{name: a}, {robot_ip: x}]", "robot 2 has no name"),
        ("robots: [a]", "robot 1 has no name"),
        ("robots: [{name: ur-a}]", "robot 1: Invalid namespace"),
        ("robots: [{name: a}, {name: /a}]", "two robots have the name a"),
        ("robots: [{name: a, rate: 1, rate: 2}]", "rate: is there twice"),
    ],
)
def test_a_file_with_an_error_is_refused_and_says_where(tmp_path, text, said):
    with pytest.raises(JointIdError, match=r"robots\.yaml: .*") as error:
        robots(tmp_path, text)
    assert said in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(JointIdError, match=r"none\.yaml: cannot be read \(No such file"):
        read_robots(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("params_file: ur3e", "robot_ip is missing"),
        ("robot_ip: x", "params_file is missing"),
        ("robot_ip: x, params_file: ur9", "ur9: no such file; installed are"),
        ("robot_ip: x, params_file: ur3e, hopp_s: 1", "did you mean hop_s?"),
        ("robot_ip: x, params_file: ur3e, hop_s: fast", "hop_s:=fast: write a number"),
        ("robot_ip: x, params_file: ur3e, model: pendulum", "model: pendulum: choose one of"),
        ("robot_ip: x, params_file: ur3e, joints: {a: 1}", "joints: {'a': 1} is no text"),
        ("robot_ip: x, params_file: ur3e, namespace: y", "namespace is no argument"),
        ("robot_ip: x, params_file: ur3e, launch: demo", "launch: demo: choose one of robot, arm"),
        ("robot_ip: x, params_file: ur3e, state_file: ./a.json", "state_file of identifier is"),
    ],
)
def test_a_robot_with_an_error_leaves_the_others_alone(tmp_path, monkeypatch, entry, said):
    monkeypatch.chdir(tmp_path)
    assert said in problem(tmp_path, entry)


def test_a_state_file_in_a_parameter_file_that_robots_share_is_noticed(tmp_path):
    shared = tmp_path / "shared.yaml"
    shared.write_text("/**/identifier:\n  ros__parameters:\n    state_file: /var/known.json\n")
    text = f"all: {{params_file: {shared}}}\nrobots: [{{name: a, robot_ip: x}}, {{name: b, robot_ip: y}}]\n"
    a, b = robots(tmp_path, text)
    assert not a.problem and "/var/known.json, as that of a" in b.problem
