"""No message ends a node: the callbacks of real node objects, fed with whatever hypothesis thinks of."""

import os
import time

import pytest
import rclpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from joint_id_core.formats.topics import CONDITIONS, RAW, SAMPLES
from joint_id_core.rtde.client import Sample
from joint_id_msgs.msg import JointParams, JointSamples
from joint_id_ros import conversions as convert
from joint_id_ros.nodes.driver import DriverNode
from joint_id_ros.nodes.filter import KINDS, FilterNode
from joint_id_ros.nodes.identifier import IdentifierNode

from .odd_messages import NUMBERS, odd_messages

pytestmark = pytest.mark.hypothesis  # of the functions in these tests
TOPICS = {topic.name: topic for topic in (*RAW, CONDITIONS)}
BEGIN = 200 * 10**9  # later than all stamps of odd messages but the largest, which are another run
PERIOD_NS = 2_000_000
FUZZ = settings(
    deadline=None, max_examples=25 * int(os.environ.get("MORE_EXAMPLES", "1")), derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip


@pytest.fixture
def ros(domain):
    """Make a node with parameters; its publishers give to a list."""
    nodes = []

    def make(kind, **parameters):
        arguments = ["--ros-args"]
        for name, value in parameters.items():
            arguments += ["-p", f"{name}:={value}"]
        rclpy.init(args=arguments)
        nodes.append(kind())
        return nodes[-1]

    yield make
    for node in nodes:
        node.close()
        node.destroy_node()
    rclpy.try_shutdown()


class Published:
    """Stands in for a publisher."""

    def __init__(self):
        self.messages = []

    def publish(self, message):
        self.messages.append(message)


RAW_MESSAGES = st.one_of(
    *(
        odd_messages(topic, KINDS[topic.name]).map(lambda message, name=topic.name: (name, message))
        for topic in TOPICS.values()
    )
)


def good_link_state(k, begin=BEGIN):
    message = JointState(name=["joint"], position=[0.001 * k], effort=[0.5])
    message.header.stamp = convert.to_stamp(begin + k * PERIOD_NS)
    return message


def test_the_filter_goes_on_after_any_messages(ros):
    node = ros(FilterNode, join_wait_s=0.0)
    out = node._publisher = Published()
    begins = iter(range(BEGIN, BEGIN + 10**14, 10**11))

    @FUZZ
    @given(st.lists(RAW_MESSAGES, max_size=12))
    def feed(messages):
        for name, message in messages:
            problems = sum(node._diagnostics.problems.values())
            node.streams.pass_on({name: [(serialize_message(message), {})]})
            told = sum(node._diagnostics.problems.values()) > problems
            arrays = [getattr(message, f) for f in TOPICS[name].fields]
            others = name == CONDITIONS.name and not len(message.joint_temperatures)  # it may hold what others read
            assert told or others or (message.name and any(map(len, arrays))), (
                "a message that says nothing was not reported"
            )
        node._on_timer()
        out.messages.clear()
        begin = next(begins)
        for k in range(300):
            node.streams.pass_on({"link_states": [(serialize_message(good_link_state(k, begin)), {})]})
        samples = [deserialize_message(m, JointSamples) for m in out.messages]
        good = {convert.nanoseconds(m.header.stamp): m for m in samples}
        sample = good[begin + 100 * PERIOD_NS]
        k = list(sample.name).index("joint")
        assert sample.link_position[k] == 0.1 and sample.current[k] == 0.5

    feed()
    assert node._diagnostics.problems["message left out"] > 0


def test_the_identifier_goes_on_after_any_samples(ros):
    node = ros(IdentifierNode, model="rigid_joint", actuation="torque", window_s=0.5, hop_s=0.1, autostart="false")
    assert node.start()
    out = node._latest._publisher = Published()

    def drained():
        end = time.monotonic() + 120.0
        while not node._worker.idle:
            assert time.monotonic() < end, "the thread takes no samples any more"
            time.sleep(0.01)

    @FUZZ
    @given(st.lists(odd_messages(SAMPLES, JointSamples), max_size=12))
    def feed(messages):
        for message in messages:
            message.measured = 2**9 - 1
            node.streams.pass_on({"joint_samples": [(serialize_message(message), {})]})
        drained()

    feed()
    assert node._diagnostics.problems["message left out"] > 0
    assert not node._diagnostics.problems["internal error"]
    for k in range(400):
        good = JointSamples(name=["joint"], measured=JointSamples.LINK_POSITION | JointSamples.TORQUE)
        good.header.stamp = convert.to_stamp(BEGIN + k * PERIOD_NS)
        good.link_position, good.torque = [0.5], [0.0]
        node.streams.pass_on({"joint_samples": [(serialize_message(good), {})]})
    drained()
    newest = deserialize_message(out.messages[-1], JointParams)
    assert newest.header.stamp.sec == BEGIN // 10**9
    assert "joint" in [j.joint for j in newest.joints]


SIX = st.tuples(*[NUMBERS] * 6)
VALUES = st.fixed_dictionaries(
    {
        "timestamp": NUMBERS | st.floats(0.0, 1e6),
        "robot_mode": st.integers(-(2**31), 2**31 - 1) | st.just(7),
        "safety_mode": st.integers(-(2**31), 2**31 - 1) | st.just(1),
        "joint_mode": st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 6),
        "actual_q": SIX,
        "actual_qd": SIX,
        "actual_current": SIX,
    }
)
GOOD = {
    "timestamp": 1.0, "robot_mode": 7, "safety_mode": 1, "joint_mode": (253,) * 6,
    "actual_q": (0.1,) * 6, "actual_qd": (0.2,) * 6, "actual_current": (0.3,) * 6,
    "joint_temperatures": (30.0,) * 6,
}  # fmt: skip


def test_the_driver_goes_on_after_any_samples(ros):
    node = ros(DriverNode, autostart="false")
    outputs = node._outputs = {topic: Published() for topic in node._messages.topics}
    begin_ns, rounds = time.time_ns(), iter(range(1, 10**6))

    def arrive(packets):
        """Packets come in as their timestamps say, or for other timestamps in the middle of a round of 10 s."""
        node._on_samples([Sample(begin_ns + round(1e9 * at), values) for at, values in packets])

    @FUZZ
    @given(st.lists(VALUES, max_size=12))
    def feed(packets):
        at = 10.0 * next(rounds)
        if packets:
            arrive([(at - 5.0, dict(values)) for values in packets])
        count = len(outputs["link_states"].messages)
        arrive([(at + 0.002 * k, {**GOOD, "timestamp": at + 0.002 * k}) for k in range(5)])
        assert len(outputs["link_states"].messages) >= count + 4
        assert list(deserialize_message(outputs["link_states"].messages[-1], JointState).position) == [0.1] * 6

    feed()
    assert node._health._held["not finite"] and node._health._held["too large"]


def test_the_parts_of_the_test_can_fail():
    """The strategies do make what the tests are about."""
    found = set()

    @settings(FUZZ, max_examples=300)
    @given(odd_messages(RAW[0], JointState))
    def look(message):
        lengths = {len(message.position), len(message.velocity), len(message.effort)}
        if message.name and lengths == {0}:
            found.add("all empty")
        if not message.name and lengths != {0}:
            found.add("no names")
        if len(set(message.name)) < len(message.name):
            found.add("twice")
        if 1e300 in message.position:
            found.add("large")

    look()
    assert found == {"all empty", "no names", "twice", "large"}
