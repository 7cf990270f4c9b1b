"""Nodes of a graph that are stopped, killed, misspelt, unreadable or at their end, each test with nodes of its own."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from robot_messages import NANO, link_state
from running_graph import RATE, Motion, instant
from sensor_msgs.msg import JointState

from joint_id_core.data.recording import Recording
from joint_id_core.formats.bag_writer import write_bag
from joint_id_msgs.msg import JointParams, JointSamples
from joint_id_ros.qos import LATEST, STREAM_OUT

PERIOD_NS = NANO // RATE


def test_a_best_effort_publisher_is_named_and_can_be_read(start, probe):
    best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = probe.create_publisher(JointState, "link_states", best_effort)
    strict = start("filter")
    text = "/link_states: publisher probe offers best effort and is not read"
    probe.until(lambda: probe.told("filter", text), "word of the publisher")
    assert "-p reliability:=best_effort" in probe.told("filter", text).message
    strict.stop()
    samples = probe.collect(JointSamples, "joint_samples")
    start("filter", reliability="best_effort")
    probe.until(lambda: publisher.get_subscription_count() == 1, "a filter that reads it")
    other = probe.create_publisher(JointState, "link_states", STREAM_OUT)  # a reliable one is read as well
    for sender, begin in ((publisher, 100), (other, 200)):
        probe.until(lambda sender=sender: sender.get_subscription_count() == 1, "the filter")
        probe.spin(1.5)
        for k in range(300):
            sender.publish(link_state(begin * NANO + k * PERIOD_NS))
            if k % 25 == 24:
                probe.spin(0.002)
        probe.until(lambda begin=begin: samples and samples[-1].header.stamp.sec >= begin, "samples")


def test_a_wrong_parameter_name_is_told_with_the_nearest_right_one(start, probe, tmp_path):
    (tmp_path / "file.yaml").write_text("/**/filter: {ros__parameters: {cutof_hz: 20.0}}")
    process = start("filter", "--params-file", str(tmp_path / "file.yaml"), orderr=3)
    for text in ("parameter cutof_hz has no effect", "did you mean cutoff_hz?", "did you mean order?"):
        probe.until(lambda text=text: probe.told("filter", text), text)
        assert probe.told("filter", text).level == b"\x01" and text in process.text
    start("identifier", modle="rigid_joint")
    probe.until(lambda: probe.told("identifier", "parameter modle has no effect"), "the wrong name")
    assert "did you mean model?" in probe.told("identifier", "parameter modle has no effect").message


SOURCES = ("sim", "driver", "player")


@pytest.mark.long
def test_sources_that_are_stopped_for_five_seconds_or_killed(start, probe, robot, tmp_path):
    """Each on its own topic; the filter of one of them says what it saw."""
    machine = robot("--moving", "none")
    instants = np.arange(60 * RATE) / RATE
    write_bag(tmp_path / "bag", {"joint": Recording(100.0 + instants, {"link_position": np.sin(instants)})})
    options = {
        "sim": {"model": "harmonic_drive"},
        "driver": {"robot_ip": "127.0.0.1", "port": machine.port},
        "player": {"bag": tmp_path / "bag", "wait_s": 1.0},
    }

    def begin(name):
        return start(name, "-r", f"__ns:=/{name}", **options[name])

    filters = [start("filter", "-r", f"__ns:=/{name}") for name in SOURCES]
    got = {name: probe.collect(JointState, f"{name}/link_states") for name in SOURCES}
    nodes = {name: begin(name) for name in SOURCES}
    probe.until(lambda: all(len(messages) > 200 for messages in got.values()), "samples of all sources")
    for node in nodes.values():
        node.signal(signal.SIGSTOP)
    probe.spin(5.0)
    counts = {name: len(messages) for name, messages in got.items()}
    for node in nodes.values():
        node.signal(signal.SIGCONT)
    probe.until(lambda: all(len(got[name]) > counts[name] + 200 for name in SOURCES), "samples after the stop")
    for name in SOURCES:
        probe.until(lambda name=name: probe.told(f"{name}/{name}", "this node did not run for"), f"word of {name}")
    for node in nodes.values():
        node.signal(signal.SIGKILL)
        node.wait()
    counts = {name: len(messages) for name, messages in got.items()}
    for name in SOURCES:
        begin(name)
    probe.until(lambda: all(len(got[name]) > counts[name] + 200 for name in SOURCES), "samples after the second start")
    for name in SOURCES:
        text = "the messages come from another publisher now"
        probe.until(lambda name=name, text=text: probe.told(f"{name}/filter", text), f"word of the filter of {name}")
    assert all(node.running for node in filters)


def test_a_replay_ends_by_itself_with_the_last_estimate(start, probe, tmp_path):
    found = probe.collect(JointParams, "joint_params", LATEST)
    begin, motion = 100.0, Motion()
    q, tau = np.array([motion.at(k) for k in range(4 * RATE)]).T
    recording = Recording(begin + np.arange(4 * RATE) / RATE, {"link_position": q, "current": tau})
    write_bag(tmp_path / "bag", {"joint": recording})
    identifier = start("identifier", model="rigid_joint", actuation="torque", window_s=1.0, end_with="filter")
    reader = start("filter", effort_source="torque", gear_ratio=1.0, wait_subscribers=1, end_with="player")
    player = start("player", bag=tmp_path / "bag", rate=2.0, wait_first_s=100.0)
    for process in (player, reader, identifier):
        probe.until(lambda process=process: not process.running, f"the end of {process.name}")
        assert process.wait() == 0
    probe.until(lambda: found, "estimates")
    (joint,) = found[-1].joints
    assert instant(joint.window_end) / NANO > begin + 4.0 - 0.51 - 0.1  # a hop and the lag of the filter
    assert joint.samples == pytest.approx(RATE, abs=5)


def test_a_bag_played_as_fast_as_possible_gives_every_estimate(start, probe, tmp_path):
    motion, seconds = Motion(), 30
    q, tau = np.array([motion.at(k) for k in range(seconds * RATE)]).T
    time = 100.0 + np.arange(seconds * RATE) / RATE
    write_bag(tmp_path / "bag", {"joint": Recording(time, {"link_position": q, "current": tau})})
    identifier = start("identifier", model="rigid_joint", actuation="torque", recorded=True)
    how = {"effort_source": "torque", "gear_ratio": 1.0}
    reader = start("filter", **how, wait_subscribers=1, recorded=True, end_with="player")
    player = start("player", bag=tmp_path / "bag", rate=0.0, wait_first_s=100.0)
    for process in (player, reader):
        probe.until(lambda process=process: not process.running, f"the end of {process.name}")
        assert process.wait() == 0
    probe.until(
        lambda: probe.values_of("identifier").get("received") == str(seconds * RATE), "all samples in the diagnostics"
    )
    probe.until(lambda: probe.values_of("identifier")["backlog"] == "0", "the last estimate")
    probe.spin(1.5)
    values = probe.values_of("identifier")
    assert values["samples left out"] == values["missed hops"] == "0"
    assert not [key for key in values if "lost" in key]
    assert sum(int(n) for key, n in values.items() if key.startswith("fits: ")) >= (seconds - 2.0) / 0.5 - 2
    assert identifier.running


def test_a_replay_whose_identifier_cannot_begin_ends(start, probe):
    identifier = start("identifier", model="rigid_joint", set=["mass=3"], end_with="filter")
    assert identifier.wait() == 2
    assert "model rigid_joint has no parameter 'mass'" in identifier.text


def test_every_row_of_the_page_names_a_test_that_exists():
    page = Path(__file__).resolve().parent.parent / "docs/reliability.md"
    section = page.read_text().split("## What the graph does when something goes wrong")[1].split("\n## ")[0]
    named = set(re.findall(r"`(test_\w+)` \|\n", section))
    files = [
        Path(__file__).with_name(f"test_{name}.py")
        for name in ("graph_faults", "graph_nodes", "identifier_start", "knowledge_node")
    ] + [
        Path(__file__).resolve().parent.parent / "ros2_ws/src" / name
        for name in ("joint_id_core/test/test_state_file.py", "joint_id_ros/test/test_transport.py")
    ]
    there = {name for file in files for name in re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE)}
    rows = [line for line in section.splitlines() if line.startswith("| ") and "---" not in line][1:]
    assert len(rows) > 20 and all(re.search(r"`test_\w+` \|$", row) for row in rows)
    assert named <= there
