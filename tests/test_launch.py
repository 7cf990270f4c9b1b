"""The launch files under the real `launch`, where it is installed: what they start and with which parameters."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState

from joint_id_msgs.msg import JointParams, JointSamples
from joint_id_ros.launch_files import LAUNCH_FILES
from joint_id_ros.qos import LATEST

pytest.importorskip("launch_ros", reason="launch files need ROS's launch and launch_ros")

BAG = Path(__file__).resolve().parent.parent / "bags/model_3_steps"
SHARE = Path(get_package_share_directory("joint_id_ros"))
RUN = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
path, *given = sys.argv[1:]
included = IncludeLaunchDescription(  # as `ros2 launch` does
    PythonLaunchDescriptionSource(path), launch_arguments=[tuple(text.split(":=", 1)) for text in given]
)
service = LaunchService(argv=given)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
"""


@pytest.fixture
def launch(tmp_path, domain):
    """Start a launch file with arguments; ended with the test."""
    started = []
    environment = {**os.environ, "ROS_LOG_DIR": str(tmp_path / "log")}

    def begin(name, **given):
        arguments = [f"{key}:={value}" for key, value in given.items()]
        command = [sys.executable, "-c", RUN, str(SHARE / "launch" / f"{name}.launch.py"), *arguments]
        with (tmp_path / f"{name}.log").open("w") as log:
            started.append(
                subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=tmp_path, start_new_session=True)
            )
        return started[-1]

    yield begin
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does: launch leaves that to it
            process.wait(60.0)
    for path in tmp_path.glob("*.log"):
        print(path.read_text())  # shown by pytest when the test fails


def value(probe, node, name):
    """A parameter of a running node, as it has it."""
    answer = probe.call(GetParameters, f"/{node}/get_parameters", GetParameters.Request(names=[name])).values[0]
    held = {1: "bool_value", 2: "integer_value", 3: "double_value", 4: "string_value", 8: "double_array_value",
            9: "string_array_value"}[answer.type]  # fmt: skip
    found = getattr(answer, held)
    return found if isinstance(found, str | bool | int | float) else list(found)


@pytest.mark.parametrize("name", LAUNCH_FILES)
def test_the_arguments_that_launch_shows_are_those_that_are_described(name):
    from joint_id_ros.launching import description

    shown = {
        a.name: (a.default_value[0].text if a.default_value else "" if a.default_value == [] else None, a.choices)
        for a in description(name).get_launch_arguments()
    }
    assert shown == {a.name: (a.default, list(a.choices) or None) for a in LAUNCH_FILES[name].arguments}


def test_the_demo_moves_and_filters(launch, probe):
    samples = probe.collect(JointSamples, "arm/joint_samples")
    launch("demo", namespace="arm", model="harmonic_drive", hop_s="1")
    probe.until(lambda: len(samples) > 10, "samples")
    assert value(probe, "arm/identifier", "model") == value(probe, "arm/sim", "model") == "harmonic_drive"
    assert value(probe, "arm/identifier", "hop_s") == 1.0
    assert value(probe, "arm/identifier", "set")[0].startswith("k_t=")


def test_a_robot_gets_its_installed_file_and_what_is_given_wins(launch, probe, robot):
    machine = robot("--moving", "none")
    links = probe.collect(JointState, "link_states")
    launch("robot", robot_ip="127.0.0.1", port=machine.port, params_file="ur3e", rate="250", window_s="2", joints="1,2",
           set="1.k_t=0.1,2.k_t=0.1")  # fmt: skip
    probe.until(lambda: links, "samples")
    assert value(probe, "driver", "joints")[2] == "elbow_joint"  # from the file
    assert value(probe, "driver", "rate") == 250.0  # 500 in the file
    assert value(probe, "identifier", "window_s") == 2.0  # the default, but another in the file
    assert value(probe, "identifier", "joints") == ["1", "2"]  # texts, though they look like numbers


def test_a_replay_ends_by_itself_after_the_last_estimate(launch, probe):
    found = probe.collect(JointParams, "joint_params", LATEST)
    process = launch("replay", bag=BAG, rate="3")
    probe.until(lambda: process.poll() is not None, "the end of the replay")
    assert process.returncode == 0
    probe.until(lambda: found, "estimates")
    duration = yaml.safe_load(BAG.with_suffix(".yaml").read_text())["duration_s"]
    links = [j.window_end.sec + j.window_end.nanosec * 1e-9 for m in found for j in m.joints]
    begin = found[0].joints[0].window_start
    assert links[-1] - (begin.sec + begin.nanosec * 1e-9) > duration - 0.6


def test_a_replay_of_a_bad_bag_ends_all_nodes_and_tells(launch, tmp_path):
    (tmp_path / "bad.mcap").write_bytes(b"no bag at all")
    process = launch("replay", bag=tmp_path / "bad.mcap", model="rigid_joint", actuation="torque")
    assert process.wait(120.0) == 1
    text = (tmp_path / "replay.log").read_text()
    assert "player has ended with exit code 2" in text and "bad.mcap" in text


@pytest.mark.long
def test_a_replay_with_a_wrong_option_ends_all_nodes_and_tells(launch, tmp_path):
    process = launch("replay", bag=BAG, model="rigid_joint", set="mass=3")
    assert process.wait(120.0) == 1
    text = (tmp_path / "replay.log").read_text()
    assert "model rigid_joint has no parameter 'mass'" in text and "identifier has ended with exit code 2" in text


def test_a_node_that_was_killed_is_started_again(launch, probe, tmp_path):
    samples = probe.collect(JointSamples, "joint_samples")
    launch("demo", respawn="true", log_level="warn")
    probe.until(lambda: len(samples) > 10, "samples")
    told = (tmp_path / "demo.log").read_text()
    number = int(re.search(r"\[filter-\d+\]: process started with pid \[(\d+)\]", told)[1])
    os.kill(number, signal.SIGKILL)
    count = len(samples)
    probe.until(lambda: len(samples) > count + 1000, "samples of the second filter")
    own = [line for line in (tmp_path / "demo.log").read_text().splitlines() if line.startswith("[identifier-1]")]
    assert not any("[INFO]" in line for line in own)
