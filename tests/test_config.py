"""Parameter files name parameters that exist, with values that are allowed; layouts name fields that exist."""

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import fields
from pathlib import Path

import pytest
import yaml
from sensor_msgs.msg import JointState

from joint_id_core.models import build
from joint_id_msgs.msg import JointEstimate, JointParams, JointSamples, ParameterEstimate
from joint_id_ros.options.identifier import IdentifierOptions
from joint_id_ros.options.node_list import NODES

CONFIG = Path(__file__).resolve().parent.parent / "config"
TOPICS = {"joint_params": JointParams, "truth": JointParams, "joint_samples": JointSamples, "link_states": JointState}
NESTED = {"joint_id_msgs/JointEstimate": JointEstimate, "joint_id_msgs/ParameterEstimate": ParameterEstimate}


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.yaml")), ids=lambda p: p.name)
def test_a_parameter_file_builds_the_options_of_its_nodes(path):
    for node, content in yaml.safe_load(path.read_text()).items():
        given = dict(content["ros__parameters"])
        given.pop("use_sim_time", None)
        if node == "/**/player":
            given["bag"] = "given on the command line"
        for options in NODES[node.removeprefix("/**/")]:
            own = {f.name: f for f in fields(options) if f.name in given}
            for name, f in own.items():
                # A number without a point is an integer to ROS and refused for a parameter in floating point.
                assert type(given[name]) is (list if isinstance(f.default, tuple) else type(f.default)), name
            built = options(**{n: tuple(v) if isinstance(v := given.pop(n), list) else v for n in own})
            if isinstance(built, IdentifierOptions):
                for joint in built.expected or ("",):
                    built.build(built.drives[-1]).values(built.values(joint))
        assert not given, f"{node} has no parameter {', '.join(given)}"


@pytest.mark.parametrize("begin", ["ros2 run joint_id_ros identifier", "ros2 launch joint_id_ros replay.launch.py"])
def test_commands_for_joint_states_have_the_windows_of_the_parameter_file(begin):
    page = (CONFIG.parent / "docs/tutorials/ur_robots.md").read_text()
    (line,) = [line for line in page.splitlines() if line.startswith(begin) and "model:=rigid_joint" in line]
    given = yaml.safe_load((CONFIG / "ur_joint_states.yaml").read_text())["/**/identifier"]["ros__parameters"]
    told = {name: float(value) for name, value in re.findall(r"(window_s|hop_s):=([\d.]+)", line)}
    assert told == {name: given[name] for name in ("window_s", "hop_s")}


ROBOTS = ("ur3e", "ur5e", "ur10e")


def unsourced(text):
    """Lines with a value that name neither a source of the head nor a guess nor a choice of ours.

    What is said of the robot's mechanics cannot be a choice, and its uncertainty stands beside it.
    """
    known = set(re.findall(r"^# \[(\d+)\] \w", text, re.MULTILINE))
    bad = []
    for line in text.splitlines():
        value, _, comment = line.partition("#")
        if not value.strip() or value.rstrip().endswith(":"):
            continue
        cited = set(re.findall(r"\[(\d+)\]", comment))
        mechanics = any(word in value for word in ("k_t=", "N=", "gear_ratio"))
        sourced = bool(cited) and (not mechanics or "%" in comment)
        excused = "guess" in comment or ("choice" in comment and not mechanics)
        if not cited <= known or not (sourced or excused):
            bad.append(line.strip())
    return bad


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_value_for_a_robot_has_its_source_or_is_called_a_guess(robot):
    text = (CONFIG / f"{robot}.yaml").read_text()
    assert unsourced(text) == []
    spoilt = re.sub(r"(k_t=[^ ]+)  #.*", r"\1  # choice", text).replace("rate: 500.0  #", "rate: 500.0  # [99]")
    assert len(unsourced(spoilt)) == 1 + 2 * 6  # of two nodes


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_has_a_torque_constant_for_every_joint_and_one_ratio_everywhere(robot):
    nodes = {k: v["ros__parameters"] for k, v in yaml.safe_load((CONFIG / f"{robot}.yaml").read_text()).items()}
    driver, identifier = nodes["/**/driver"], nodes["/**/identifier"]
    assert driver["joints"] == identifier["joints"]
    assert nodes["/**/arm_identifier"]["set"] == identifier["set"]
    options = IdentifierOptions(joints=tuple(identifier["joints"]), set=tuple(identifier["set"]))
    values = [options.values(joint) for joint in driver["joints"]]
    assert all(0.02 < v["k_t"] < 0.2 for v in values)
    spreads = [options.deviations(joint)["k_t"] / options.values(joint)["k_t"] for joint in driver["joints"]]
    assert all(0.01 < spread < 0.3 for spread in spreads)
    assert {v["N"] for v in values} == set(driver["gear_ratio"])


@pytest.mark.parametrize("name", ["demo_electromechanical", "demo_harmonic_drive"])
def test_a_parameter_file_reaches_the_node_in_any_namespace(start, probe, name):
    process = start("identifier", "--params-file", str(CONFIG / f"{name}.yaml"), "-r", "__ns:=/left/arm")
    model = name.removeprefix("demo_")
    probe.until(lambda: f"identifying {model} with" in process.text, "the identifier")


def resolve(path):
    """Follow a path such as /topic.joints[0].parameters[:]{name=="k_1"}.value through the message types."""
    topic, *names = [p for p in re.split(r"[./]", path) if p]
    kind = TOPICS[topic]
    for name in names:
        field = re.match(r"\w+", name)[0]
        text = kind.get_fields_and_field_types()[field]
        assert ("[" in name) == text.startswith("sequence<"), f"{path}: {field} is {text}"
        inner = text.removeprefix("sequence<").removesuffix(">")
        for condition in re.findall(r"\{(\w+)==", name):
            assert condition in NESTED[inner].get_fields_and_field_types()
        kind = NESTED.get(inner, kind)
    return inner if names else None


def test_the_foxglove_layout_shows_fields_that_exist():
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    panels = layout["configById"]
    values = [p["value"] for panel in panels.values() for p in panel.get("paths", [])]
    assert len(values) > 5
    for value in values:
        assert resolve(value) in ("double", "uint8")
    resolve(panels["RawMessages!params"]["topicPath"])
    assert panels["DiagnosticSummary!nodes"]["topicToRender"] == "/diagnostics"

    def leaves(node):
        return {node} if isinstance(node, str) else leaves(node["first"]) | leaves(node["second"])

    assert leaves(layout["layout"]) == set(panels)


def test_the_plotjuggler_layout_shows_fields_that_exist_and_the_parameters_it_names():
    root = ElementTree.parse(CONFIG / "plotjuggler.xml").getroot()
    names = build("electromechanical").parameter_names
    for area in root.iter("DockArea"):
        for curve in area.iter("curve"):
            path = curve.get("name")
            assert resolve(path) in ("double", "uint8")
            if found := re.search(r"parameters\[(\d+)\]", path):
                assert names[int(found[1])] in area.get("name").split()
    topics = [topic.get("name").strip("/") for topic in root.iter("topic")]
    assert topics and set(topics) <= set(TOPICS)
