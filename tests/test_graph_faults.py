"""What filter and identifier do when something goes wrong: every fault over real DDS, on one running graph.

docs/reliability.md has a row for each of these tests.
"""

from __future__ import annotations

import math
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
import rclpy
from conftest import Probe, Process
from rclpy.context import Context
from rclpy.qos import QoSProfile, ReliabilityPolicy
from robot_messages import NANO, link_state, stamp
from ros_domain import own_domain
from running_graph import RATE, TRUTH, Graph, Motion, instant
from sensor_msgs.msg import JointState

from joint_id_core.data.recording import Recording
from joint_id_core.formats.bag_writer import write_bag
from joint_id_msgs.msg import JointParams, JointSamples
from joint_id_ros.qos import LATEST, STREAM_OUT


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A filter and an identifier for all tests of this file."""
    processes = []
    with own_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}

        def start(name, **parameters):
            arguments = [text for key, value in parameters.items() for text in ("-p", f"{key}:={value}")]
            output = tmp_path_factory.mktemp(name) / "log"
            processes.append(Process(name, output, environment, ["--ros-args", *arguments]))
            return processes[-1]

        context = Context()
        rclpy.init(context=context, domain_id=domain)
        probe = Probe(context)
        graph = Graph(probe, start)
        graph.right_again()
        yield graph
        for process in processes:
            process.stop()
        for process in processes:
            assert "Traceback" not in process.text, process.text
        probe.destroy_node()
        context.try_shutdown()


@pytest.fixture
def graph(running):
    """The running graph; only what it says from now on counts."""
    running.probe.diagnostics.clear()
    running.names, running.step = ["joint"], 1
    yield running
    assert running.filter.running and running.identifier.running


def with_nan(message, k):
    if k % 7 == 0:
        message.position = [math.nan]


def some(**fields):
    """Replace fields of one message."""

    def spoil(message, k):
        if k == 50:
            for name, value in fields.items():
                setattr(message, name, value)

    return spoil


def restamped(shift_ns):
    """Shift the stamp of one message."""

    def spoil(message, k):
        if k == 50:
            message.header.stamp = stamp(instant(message.header.stamp) + shift_ns)

    return spoil


def unstamped(message, k):
    if k == 50:
        message.header.stamp = stamp(0)


PERIOD_NS = NANO // RATE
FAULTS = {
    "NaN": (with_nan, "not finite, left out for that joint"),
    "inf": (some(position=[math.inf]), "position of joint joint is infinite"),
    "1e300": (some(effort=[1e300]), "effort of joint joint is 1e+300"),
    "repeated stamp": (restamped(-PERIOD_NS), "the stamp repeats"),
    "reordered stamp": (restamped(-5 * PERIOD_NS), "goes back by 0.008 s"),
    "zero stamp": (unstamped, "the stamp is zero"),
    "array too long": (some(position=[0.0, 1.0]), "2 values of position for 1 joints"),
    "empty arrays": (some(position=[], effort=[]), "holds no values"),
    "empty message": (some(name=[], position=[], effort=[]), "names no joint"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_message_is_left_out_and_named(graph, fault):
    spoil, text = FAULTS[fault]
    graph.send(0.5, spoil)
    graph.told("filter", text)
    graph.right_again()


def zeros(message, k):
    message.position, message.effort = [0.0], [0.0]


def test_zeros_are_not_believed(graph):
    begin = len(graph.found)
    graph.send(0.3, zeros)
    graph.send(2.0)
    graph.right_again()
    seen = [j for m in graph.found[begin:] for j in m.joints]
    assert any(j.status != j.CONVERGED for j in seen)


def test_samples_that_the_source_did_not_send(graph):
    graph.send(0.5)
    graph.k += RATE // 2
    graph.send(0.5)
    graph.told("filter", "250 samples lost: its publisher did not send them")
    graph.right_again()


def test_a_joint_that_vanishes_is_taken_back_and_returns(graph):
    graph.names = ["joint", "other"]
    graph.right_again("other")
    graph.names = ["joint"]
    graph.send(4.0)
    graph.told("filter", "joint other disappeared")
    graph.told("identifier", "joint other is not in joint_samples any more")
    graph.probe.until(lambda: graph.newest("other") is None, "its end")
    assert graph.newest() is not None
    graph.names = ["joint", "other"]
    graph.right_again("other")
    graph.names = ["joint"]
    graph.send(4.0)


def test_a_joint_with_another_name_leaves_no_twin(graph):
    graph.names = ["renamed"]
    graph.right_again("renamed")
    graph.told("filter", "joint joint disappeared and joint renamed appeared: has it got another name?")
    graph.send(2.0)
    graph.probe.until(lambda: graph.newest() is None, "the end of the old name")
    graph.names = ["joint"]
    graph.right_again()
    graph.send(2.0)
    graph.probe.until(lambda: graph.newest("renamed") is None, "the end of the twin")


def test_another_sampling_rate(graph):
    graph.step = 4
    graph.send(0.5)
    graph.told("filter", "the sampling rate changed from 500 to 125 Hz")
    graph.send(1.0)
    graph.told("identifier", "the sampling rate changed from 500 to 125 Hz: identification starts anew")
    slow = graph.estimate_of_now()
    assert slow.status == slow.CONVERGED, slow.message
    assert slow.samples == pytest.approx(250, abs=2)
    for p in slow.parameters:  # with fewer samples they are off by more than their standard deviations
        assert p.name not in TRUTH or p.value == pytest.approx(TRUTH[p.name], rel=0.3)
    graph.step = 1
    graph.right_again()
    graph.told("identifier", "the sampling rate changed from 125 to 500 Hz")


def test_a_clock_that_jumps_ahead(graph):
    graph.shift_ns += 3600 * NANO
    graph.send(0.5)
    graph.told("filter", "the stamps jump ahead by 3600")
    graph.right_again()


def test_a_clock_that_jumps_back(graph):
    graph.shift_ns -= 3600 * NANO
    graph.send(0.5)
    graph.told("filter", "time jumps")
    graph.told("identifier", "time jumped back: identification starts anew")
    graph.right_again()


def test_another_publisher_takes_over(graph):
    graph.probe.destroy_publisher(graph.publisher)
    graph.publisher = graph.probe.create_publisher(JointState, "link_states", STREAM_OUT)
    graph.wait_for_readers()
    graph.send(0.5)
    graph.told("filter", "the messages come from another publisher now")
    graph.right_again()


def test_of_two_publishers_one_is_read(graph):
    second = graph.probe.create_publisher(JointState, "link_states", STREAM_OUT)
    graph.probe.until(lambda: second.get_subscription_count() > 0, "the filter")

    def disturb():
        message = JointState(name=["joint"], position=[0.0], effort=[0.0])
        message.header.stamp = stamp(graph.now_ns + PERIOD_NS // 3)
        second.publish(message)

    graph.right_again(also=[disturb])
    graph.told("filter", "/link_states has 2 publishers (probe, probe): one of them is read; end the others")
    graph.probe.destroy_publisher(second)
    graph.right_again()


@pytest.mark.parametrize("node", ["filter", "identifier"])
def test_a_node_that_is_killed_and_started_again(graph, node):
    graph.replace(node)
    graph.right_again()


def test_a_filter_that_is_stopped_for_five_seconds(graph):
    graph.pause("filter", 5.0)
    graph.told("filter", "this node did not run for")
    graph.told("filter", "this computer read them too late")  # the publisher keeps 4 s
    graph.right_again()


def test_an_identifier_that_is_stopped_for_five_seconds(graph):
    graph.pause("identifier", 5.0)
    graph.told("identifier", "this node did not run for")
    graph.told("identifier", "behind the newest sample")
    assert graph.probe.told("identifier", "behind the newest sample").level == b"\x02"
    graph.told("identifier", "estimates were left out, because fits take longer than hop_s")
    graph.right_again()


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


def test_a_replay_whose_identifier_cannot_begin_ends(start, probe):
    identifier = start("identifier", model="rigid_joint", set=["mass=3"], end_with="filter")
    assert identifier.wait() == 2
    assert "model rigid_joint has no parameter 'mass'" in identifier.text


def test_every_row_of_the_page_names_a_test_that_exists():
    page = Path(__file__).resolve().parent.parent / "docs/reliability.md"
    section = page.read_text().split("## What the graph does when something goes wrong")[1].split("\n## ")[0]
    named = set(re.findall(r"`(test_\w+)` \|\n", section))
    files = (Path(__file__), Path(__file__).with_name("test_identifier_start.py"))
    there = {name for file in files for name in re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE)}
    rows = [line for line in section.splitlines() if line.startswith("| ") and "---" not in line][1:]
    assert len(rows) > 20 and all(re.search(r"`test_\w+` \|$", row) for row in rows)
    assert named <= there
