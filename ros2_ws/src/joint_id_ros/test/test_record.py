"""`joint-id record` in a process of its own, against a real publisher over DDS."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from joint_id_msgs.msg import JointEstimate, JointParams, ParameterEstimate

PATIENCE_S = 180.0  # a limit for tests that hang, not a measure of speed
PATIENCE = Duration(seconds=PATIENCE_S)
RECORD = (
    "import typer; from joint_id_ros.record import record; app = typer.Typer(pretty_exceptions_enable=False);"
    "app.command()(record); app()"
)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
# A publisher may also be best effort; a reliable subscription would never hear it.
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def node(domain):
    rclpy.init()
    node = rclpy.create_node("source")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def start(*arguments) -> subprocess.Popen:
    command = [sys.executable, "-c", RECORD, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_subscriptions(*publishers):
    end = time.monotonic() + PATIENCE_S
    while not all(p.get_subscription_count() for p in publishers):
        assert time.monotonic() < end, "the recorder did not subscribe"
        time.sleep(0.01)


def messages(bag: Path) -> dict[str, list]:
    found: dict[str, list] = {}
    with AnyReader([bag]) as reader:
        for connection, stamp, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp, message))
    return found


@pytest.mark.parametrize("stop", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_every_message_before_the_signal_is_in_the_bag(node, tmp_path, stop):
    states = node.create_publisher(JointState, "link_states", 2000)
    loose = node.create_publisher(JointState, "motor_states", BEST_EFFORT)
    params = node.create_publisher(JointParams, "joint_params", LATCHED)
    estimate = JointEstimate(joint="elbow", parameters=[ParameterEstimate(name="k_1", value=4467.0)])
    params.publish(JointParams(joints=[estimate]))  # before anybody listens: latched
    process = start(tmp_path / "bag")
    try:
        wait_for_subscriptions(states, loose, params)
        before = time.time_ns()
        loose.publish(JointState(name=["elbow"], velocity=[3.0]))  # first: nobody says whether it has arrived
        for k in range(500):
            states.publish(JointState(name=["elbow"], position=[0.001 * k]))
            time.sleep(0.001)
        assert states.wait_for_all_acked(PATIENCE)
        process.send_signal(stop)
        out, err = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert (process.returncode, err) == (0, "")
    assert "502 messages on 3 topics" in out
    found = messages(tmp_path / "bag")
    assert [m.position[0] for _, m in found["/link_states"]] == [0.001 * k for k in range(500)]
    assert all(before <= stamp <= time.time_ns() for stamp, _ in found["/link_states"])
    assert found["/motor_states"][0][1].velocity[0] == 3.0
    assert found["/joint_params"][0][1].joints[0].parameters[0].value == 4467.0


def test_only_the_named_topics(node, tmp_path):
    wanted = node.create_publisher(JointState, "link_states", LATCHED)
    other = node.create_publisher(JointState, "motor_states", LATCHED)
    wanted.publish(JointState(name=["elbow"], position=[1.0]))
    other.publish(JointState(name=["elbow"], position=[2.0]))
    process = start(tmp_path / "bag", "link_states", "never")
    try:
        wait_for_subscriptions(wanted)
        assert wanted.wait_for_all_acked(PATIENCE)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 0, err
    assert "no message arrived on /never" in err
    assert list(messages(tmp_path / "bag")) == ["/link_states"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["present"], "exists already"),
        (["missing/bag"], "does not exist: create it"),
        (["bag", "--duration", "0"], "more than 0 s"),
        (["bag", "two words", "--duration", "1"], "JointIdError: topic 'two words': topic name must not contain"),
        (["bag", "/silence", "--duration", "0.3"], "no message arrived on /silence"),
    ],
)
def test_bad_input_leaves_nothing_behind(node, tmp_path, arguments, says):
    (tmp_path / "present").mkdir()
    process = start(tmp_path / arguments[0], *arguments[1:])
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode != 0
    assert says in err
    assert [p.name for p in tmp_path.iterdir()] == ["present"]
    assert not list((tmp_path / "present").iterdir())


def test_a_namespace_keeps_one_robot_a_bag(node, tmp_path):
    names = ("/left/link_states", "/left/joint_params", "/left_over/link_states", "/link_states")
    publishers = [node.create_publisher(JointState, name, 10) for name in names]
    process = start(tmp_path / "bag", "--namespace", "/left")
    wait_for_subscriptions(*publishers[:2])
    for publisher in publishers:
        publisher.publish(JointState(name=["a"]))
    assert all(p.wait_for_all_acked(PATIENCE) for p in publishers[:2])
    assert not any(p.get_subscription_count() for p in publishers[2:])
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 0
    assert set(messages(tmp_path / "bag")) == {"/left/link_states", "/left/joint_params"}
