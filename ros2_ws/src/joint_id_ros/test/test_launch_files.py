"""Launch files: arguments are the options of their nodes, and what is given wins over the parameter file."""

import ast
from dataclasses import fields
from pathlib import Path

import pytest
import rclpy
import yaml
from ament_index_python.packages import get_package_share_directory

from joint_id_core.errors import JointIdError
from joint_id_ros.launch_files import LAUNCH_FILES, LOAD, parameter_file
from joint_id_ros.options.node_list import NODES

SHARE = Path(get_package_share_directory("joint_id_ros"))


def starts(name, **given):
    """The nodes by name, with the parameters that each ends up with and the files among them."""
    launch_file = LAUNCH_FILES[name]
    values = {a.name: given.get(a.name, a.default) for a in launch_file.arguments}
    assert None not in values.values(), "an argument that must be given is not"
    return {start.name: start for start in launch_file.starts(values, given.keys())}


def own(start):
    """What a node gets from arguments and from the launch file."""
    return {**start.own, **start.given}


def test_every_launch_file_is_described_and_every_description_has_its_file():
    for folder in (SHARE / "launch", Path(__file__).parent.parent / "launch"):
        files = {path.name.removesuffix(".launch.py"): path for path in folder.glob("*.launch.py")}
        assert files.keys() == LAUNCH_FILES.keys()
        for name, path in files.items():
            calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
            assert [(c.func.id, c.args[0].value) for c in calls] == [("description", name)]


@pytest.mark.parametrize("name", LAUNCH_FILES)
def test_arguments_are_options_with_their_default_and_choices(name):
    launch_file = LAUNCH_FILES[name]
    arguments = {a.name: a for a in launch_file.arguments}
    assert len(arguments) == len(launch_file.arguments)
    for node, offered in launch_file.offers.items():
        options = {f.name: f for options in NODES[node] for f in fields(options)}
        for option in offered:
            f, argument = options[option], arguments[option]
            assert f.metadata["description"] in argument.description or len(launch_file.offers) > 1
            if argument.default is not None:
                assert argument.default in argument.choices or not argument.choices
            given = {a.name: "x" for a in launch_file.arguments if a.default is None and a.name != "params_file"}
            given |= {"params_file": "ur3e"} if "params_file" in launch_file.required else {}
            if argument.default is not None:  # the default as a text is the default
                made = own(starts(name, **given, **{option: argument.default})[node])[option]
                made = tuple(v for v in made if v != "") if isinstance(f.default, tuple) else made
                assert made == f.default and type(made) is type(f.default), option


def test_replay_takes_everything_that_says_what_is_identified():
    names = {a.name for a in LAUNCH_FILES["replay"].arguments}
    model = {f.name for f in fields(NODES["identifier"][0])} - {"autostart"}
    assert model <= names and {"free", "delays", "offsets", "cell", "priors"} <= names


def test_texts_become_values_of_the_right_type():
    made = starts("replay", bag="123", rate="0", set="N=101, k_t=0.1", gravity="true", order="2", free="")
    assert made["player"].given == {"bag": "123", "rate": 0.0}
    assert made["identifier"].given == {"set": ["N=101", "k_t=0.1"], "gravity": True, "free": [""]}
    assert made["filter"].given == {"order": 2}
    with pytest.raises(JointIdError, match="rate:=fast: write a number"):
        starts("replay", bag="b", rate="fast")


def test_in_a_replay_every_node_ends_with_the_one_before_it():
    made = starts("replay", bag="b")
    assert made["filter"].own["end_with"] == "player" and made["identifier"].own["end_with"] == "filter"
    assert made["filter"].own["use_sim_time"] is made["identifier"].own["use_sim_time"] is True
    assert LAUNCH_FILES["replay"].leader == "player"


@pytest.mark.parametrize("name", sorted(LAUNCH_FILES.keys() - {"fleet"}))  # there they stand in the robots' file
def test_every_option_of_the_identifier_is_an_argument(name):
    names = {a.name for a in LAUNCH_FILES[name].arguments}
    (identifier,) = {"identifier", "arm_identifier"} & LAUNCH_FILES[name].offers.keys()
    mine = {f.name for options in NODES[identifier] for f in fields(options)}
    without = {"reliability", "recorded", "end_with"}  # its samples come from our own filter
    assert mine - names <= without | (set(LOAD) if name == "demo" else set())  # which computes no load there
    assert "log_level" in names and ("respawn" in names) == (name != "replay")


def test_samples_are_recorded_in_a_replay_alone():
    nodes = starts("replay", bag="b")
    assert own(nodes["filter"])["recorded"] is own(nodes["identifier"])["recorded"] is True
    assert not any("recorded" in own(node) for node in starts("demo").values())


def test_bags_that_are_replayed_side_by_side_have_a_time_each():
    side = starts("replay", bag="b", namespace="left")
    assert all(("/clock", "clock") in side[node].remappings for node in ("player", "filter", "identifier"))
    assert not any(start.remappings[1:] for start in starts("replay", bag="b").values())


def test_the_link_states_may_come_from_another_topic():
    assert starts("replay", bag="b", link_states="joint_states")["filter"].remappings == [
        ("link_states", "joint_states")
    ]


def test_what_is_given_comes_after_the_file_and_what_is_not_given_is_left_to_it():
    made = starts("robot", robot_ip="192.168.0.10", params_file="ur3e", hop_s="0.5")
    assert made["identifier"].given == {"hop_s": 0.5}  # although it is the default: the file may say otherwise
    assert made["identifier"].files == [str(SHARE / "config/ur3e.yaml")]
    assert made["driver"].given == {"robot_ip": "192.168.0.10"}


@pytest.mark.parametrize("section", ["/**/identifier", "/**", "identifier", "/arm/identifier"])
def test_ros_takes_the_file_over_the_own_and_the_given_over_the_file(tmp_path, domain, section):
    """The texts as rclpy reads them, whatever section the file has."""
    file = {"ros__parameters": {"hop_s": 5.0, "window_s": 7.0, "model": "dc_motor"}}
    (tmp_path / "file.yaml").write_text(yaml.safe_dump({section: file}))
    values = {"params_file": str(tmp_path / "file.yaml"), "model": "harmonic_drive", "hop_s": "2", "namespace": ""}
    made = {a.name: values.get(a.name, a.default) for a in LAUNCH_FILES["demo"].arguments}
    (start,) = (s for s in LAUNCH_FILES["demo"].starts(made, {"hop_s"}) if s.name == "identifier")
    (tmp_path / "own.yaml").write_text(start.own_text)
    (tmp_path / "given.yaml").write_text(start.given_text)
    paths = [str(tmp_path / "own.yaml"), *start.files, str(tmp_path / "given.yaml")]
    files = [text for path in paths for text in ("--params-file", path)]
    namespace = "" if section == "identifier" else "arm"  # a bare name is that of a node without a namespace
    rclpy.init(args=["--ros-args", *files])
    node = rclpy.create_node("identifier", namespace=namespace, automatically_declare_parameters_from_overrides=True)
    found = {name: node.get_parameter(name).value for name in ("model", "hop_s", "window_s", "set")}
    node.destroy_node()
    rclpy.try_shutdown()
    assert found == {"model": "dc_motor", "hop_s": 2.0, "window_s": 7.0, "set": start.own["set"]}


def test_the_demo_knows_the_torque_constant_of_its_own_joint():
    assert own(starts("demo")["identifier"]) == {"model": "electromechanical"}
    made = starts("demo", model="harmonic_drive")
    assert own(made["sim"])["model"] == own(made["identifier"])["model"] == "harmonic_drive"
    assert own(made["identifier"])["set"][0].startswith("k_t=")


@pytest.mark.parametrize("text", ["ur3e", "ur3e.yaml"])
def test_an_installed_file_needs_only_its_name(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Path(parameter_file(text)).resolve().name == "ur3e.yaml"
    (tmp_path / "ur3e.yaml").write_text("/**/filter: {}")
    assert parameter_file("ur3e.yaml") == "ur3e.yaml"  # a file that is there comes first


def test_a_file_that_is_not_there_is_refused_with_those_that_are():
    with pytest.raises(JointIdError, match=r"params_file config/ur4e.yaml: no such file; installed are .*ur10e, ur3e"):
        parameter_file("config/ur4e.yaml")


def test_every_file_of_the_repository_is_installed():
    here = Path(__file__).parent.parent / "config"
    assert {p.name: p.read_bytes() for p in here.iterdir()} == {
        p.name: p.read_bytes() for p in (SHARE / "config").iterdir()
    }
