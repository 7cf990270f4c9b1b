"""A node that subscribes to topics as raw bytes and writes them to a bag."""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from joint_id_core.errors import JointIdError
from joint_id_core.formats.live_bag import LiveBag
from joint_id_ros.message_types import message_class

DISCOVERY_S = 0.1
DRAIN_S = 5.0  # longest time after the stop to write messages that have already arrived
SAVE_S = 0.5  # at most this much, and what waits to be received, is lost if the process is killed


class Recorder(Node):
    """Writes messages as they arrive; it finds new topics while it runs.

    Attributes:
        count: number of messages written.
    """

    def __init__(self, output: Path, topics: list[str], namespace: str = "", context: Context | None = None) -> None:
        """Begin to look for topics: those named, relative to the namespace, or else all that are in it.

        In a `context` of another node, whose names and remappings are not taken for this one.

        Raises:
            JointIdError: a name that is none.
        """
        alone = context is None
        try:
            super().__init__(
                "record", namespace=namespace, context=context, use_global_arguments=alone,
                start_parameter_services=False, enable_rosout=False,
            )  # fmt: skip
        except InvalidNamespaceException as error:
            raise JointIdError(f"namespace: {' '.join(str(error).split())}") from None
        self.count, self._below = 0, f"{self.get_namespace().rstrip('/')}/"
        self._wanted = {self._resolved(topic) for topic in topics}
        self._output = output
        self._end = math.inf  # ns; what arrives later is not written
        self._bag: LiveBag | None = None
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._counts: dict[str, int] = {}
        self._refused: set[str] = set()
        self._discover()
        clock = Clock(clock_type=ClockType.STEADY_TIME)  # these must not wait for /clock
        self.create_timer(DISCOVERY_S, self._discover, clock=clock)
        self.create_timer(SAVE_S, self._save, clock=clock)

    @property
    def summary(self) -> str:
        """Number of messages and topics written, in one line."""
        return f"{self.count} messages on {sum(n > 0 for n in self._counts.values())} topics"

    @property
    def silent(self) -> list[str]:
        """Requested topics without any message."""
        return sorted(t for t in self._wanted if not self._counts.get(t))

    def end(self) -> None:
        """Write no message that arrives from now on."""
        self._end = time.time_ns()

    def close(self) -> None:
        """Finish the bag.

        Raises:
            JointIdError: the disk is full or fails.
        """
        bag, self._bag = self._bag, None
        if bag is not None:
            bag.close()

    def _resolved(self, topic: str) -> str:
        """Return the whole name of a topic."""
        try:
            return self.resolve_topic_name(topic)
        except (rclpy_implementation.RCLError, ValueError) as error:
            said, _, _ = str(error).removeprefix("failed to resolve name: ").partition(", at ")  # a line of its source
            raise JointIdError(f"topic {topic!r}: {said}: give the name of a topic, such as joint_states") from None

    def _save(self) -> None:
        if self._bag is not None:
            self._bag.save()

    def _discover(self) -> None:
        """Subscribe to new topics that are wanted and published."""
        for topic, types in self.get_topic_names_and_types():
            wanted = topic in self._wanted if self._wanted else topic.startswith(self._below)
            if topic in self._counts or topic in self._refused or not wanted:
                continue
            publishers = self.get_publishers_info_by_topic(topic)
            if not publishers:
                continue
            try:
                if len(types) != 1:
                    raise JointIdError(f"it has several types ({', '.join(types)})")
                self._subscribe(topic, types[0], publishers)
            except JointIdError as error:
                self._refused.add(topic)
                print(f"joint-id: {topic} is left out: {error}", file=sys.stderr)

    def _subscribe(self, topic: str, type_name: str, publishers: list[Any]) -> None:
        message = message_class(type_name)
        register(self._store, type_name)
        offered = [p.qos_profile for p in publishers]
        # The strictest profile that is compatible with every publisher, so that no publisher is missed.
        reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
        latched = all(q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered)
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_ALL,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        definition, _ = self._store.generate_msgdef(type_name, ros_version=2)
        digest = self._store.hash_rihs01(type_name)
        self._counts[topic] = 0
        number: int | None = None

        def write(data: bytes, info: Any) -> None:
            nonlocal number
            if info["received_timestamp"] > self._end:
                return
            if self._bag is None:  # created with the first message: a recording without messages leaves no files
                self._bag = LiveBag(self._output)
            if number is None:
                number = self._bag.add_topic(topic, type_name, definition, digest, reliable, latched)
            self._bag.write(number, info["received_timestamp"], data)
            self._counts[topic] += 1
            self.count += 1

        self.create_subscription(message, topic, write, qos, raw=True)


def drain(recorder: Recorder, executor: Executor) -> None:
    """Write the messages that have already arrived, and none that arrives from now on."""
    recorder.end()
    end, count = time.monotonic() + DRAIN_S, -1
    while recorder.count > count and time.monotonic() < end:
        count = recorder.count
        for _ in range(100):
            executor.spin_once(timeout_sec=0.0)


def register(store: Typestore, type_name: str) -> None:
    """Add a message type and the types of its fields, from the .msg files of the installed packages.

    Raises:
        JointIdError: the definition is not installed.
    """
    if type_name in store.fielddefs:
        return
    package, _, name = type_name.split("/")
    try:
        text = (Path(get_package_share_directory(package)) / "msg" / f"{name}.msg").read_text(encoding="utf-8")
    except (PackageNotFoundError, OSError):
        raise JointIdError(f"the definition of {type_name} is not installed") from None
    found = get_types_from_msg(text, type_name)
    for _, fields in found.values():
        for _, description in fields:
            for nested in _names(description):
                register(store, nested)
    store.register(found)


def _names(description: Any) -> list[str]:
    """Return the message types in the description of a field (nested pairs of kind and content)."""
    kind, content = description
    if kind.name == "NAME":
        return [content]
    return _names(content[0]) if kind.name in ("ARRAY", "SEQUENCE") else []
