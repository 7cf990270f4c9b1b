"""What filter and identifier do when something goes wrong: every fault over real DDS, on one running graph.

docs/reliability.md has a row for each of these tests.
"""

from __future__ import annotations

import math
import time

import pytest
import rclpy
from conftest import Probe
from node_process import Process
from rclpy.context import Context
from robot_messages import NANO, stamp
from ros_domain import own_domain
from running_graph import RATE, TRUTH, Graph, assert_true, instant
from sensor_msgs.msg import JointState

from joint_id_msgs.msg import JointEstimate
from joint_id_ros.qos import STREAM_OUT


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A filter and an identifier for all tests of this file."""
    processes = []
    with own_domain():

        def start(name, **parameters):
            arguments = [text for key, value in parameters.items() for text in ("-p", f"{key}:={value}")]
            output = tmp_path_factory.mktemp(name) / "log"
            processes.append(Process(name, output, ["--ros-args", *arguments]))
            return processes[-1]

        context = Context()
        rclpy.init(context=context)
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


# The filter alone meets the others in test_filter_node.py.
QUICK = ("reordered stamp",)


@pytest.mark.parametrize("fault", [f if f in QUICK else pytest.param(f, marks=pytest.mark.long) for f in FAULTS])
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
    # A jump to zero and back is a sensor that jumps, and a rest: what is known of the joint stays.
    for joint in (j for m in graph.found[begin:] for j in m.joints if j.status == j.CONVERGED):
        assert_true(joint)


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


def test_all_joints_of_a_source_that_stops_are_taken_back_and_return(graph):
    graph.send(0.5)
    assert graph.newest() is not None
    stopped = time.monotonic()
    graph.probe.until(lambda: graph.newest() is None, "the end of the joint")
    assert time.monotonic() - stopped > 1.0
    graph.told("identifier", "no joint_samples for 2 s")
    graph.told("filter", "nothing received on link_states")
    graph.right_again()


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
    # With so few samples the torque between them is not known well: two estimators may disagree, which is right.
    slow = graph.estimate_of_now(usable=(JointEstimate.CONVERGED, JointEstimate.DISAGREE))
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

    try:
        text = "/link_states has 2 publishers (probe, probe): one of them is read; end the others"
        graph.send_until(lambda: graph.probe.told("filter", text), also=[disturb])
        graph.told("filter", text)
        graph.send(1.0, also=[disturb])
        newest = [instant(m.header.stamp) % PERIOD_NS for m in graph.samples[-200:]]
        assert len(newest) == 200 and len(set(newest)) == 1  # the stamps of the two differ by a third of a period
    finally:
        graph.probe.destroy_publisher(second)
    graph.right_again()


@pytest.mark.parametrize("node", ["identifier", pytest.param("filter", marks=pytest.mark.long)])
def test_a_node_that_is_killed_and_started_again(graph, node):
    graph.replace(node)
    graph.right_again()


def test_a_filter_that_is_stopped_for_seven_seconds(graph):
    graph.pause("filter", 7.0)
    graph.told("filter", "this node did not run for")
    graph.told("filter", "this computer read them too late")  # the publisher keeps 4 s, the middleware 1 s
    graph.right_again()


def test_an_identifier_that_is_stopped_for_five_seconds(graph):
    graph.pause("identifier", 5.0)
    graph.told("identifier", "this node did not run for")
    graph.told("identifier", "behind the newest sample")
    assert graph.probe.told("identifier", "behind the newest sample").level == b"\x02"
    # How many estimates are left out while it catches up depends on the computer; `test_worker.py` tests their count.
    graph.right_again()
