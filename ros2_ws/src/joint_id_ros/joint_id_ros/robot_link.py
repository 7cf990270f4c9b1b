"""What the node `identify` sees of a robot and does with it: samples, trajectories, recordings."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from joint_id_core.data.instants import NANO
from joint_id_core.design.trajectory_watch import TrajectoryWatch
from joint_id_core.formats.topics import CONDITIONS, RAW
from joint_id_ros.background_recorder import BackgroundRecorder
from joint_id_ros.conversions import nanoseconds
from joint_id_ros.trajectories import QOS, STOP, TOPIC

LINK_STATES = RAW[0].name
RECORDED = (*(topic.name for topic in RAW), CONDITIONS.name)
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # every publisher is read


class RobotLink:
    """Reads the newest sample when `look` is called; the others are only recorded.

    Args:
        node: with the topics.
        silent_s: time in s without samples after which they are missed.
    """

    def __init__(self, node: Node, silent_s: float) -> None:
        self._node, self.silent_s = node, silent_s
        self._trajectory = node.create_publisher(JointTrajectory, TOPIC, QOS)
        self._subscription = node.create_subscription(JointState, LINK_STATES, self._on_sample, NEWEST, raw=True)
        self._newest = b""
        self._came_s = float("-inf")
        self._positions: dict[str, float] = {}
        self._watch: TrajectoryWatch | None = None
        self._watched: Sequence[str] = ()

    def close(self) -> None:
        """End the subscription and the publisher."""
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_publisher(self._trajectory)

    def _on_sample(self, data: bytes) -> None:
        self._newest, self._came_s = data, time.monotonic()

    def look(self) -> None:
        """Take the newest sample into account."""
        if not self._newest:
            return
        message: Any = deserialize_message(self._newest, JointState)
        self._newest, self._positions = b"", dict(zip(message.name, message.position, strict=False))
        if self._watch is not None and all(joint in self._positions for joint in self._watched):
            stamp = nanoseconds(message.header.stamp) / NANO
            self._watch.add(stamp, [self._positions[joint] for joint in self._watched])

    def positions(self) -> dict[str, float]:
        """Return where the joints are, in rad, as of the newest sample; none if there was none lately."""
        return self._positions if time.monotonic() - self._came_s < self.silent_s else {}

    def watch(self, joints: Sequence[str]) -> TrajectoryWatch:
        """Return a watch that gets the positions of these joints from now on."""
        self._watch, self._watched = TrajectoryWatch(), joints
        return self._watch

    def send(self, trajectory: bytes) -> int:
        """Publish the bytes of a JointTrajectory; return how many subscribers there are."""
        self._trajectory.publish(trajectory)
        return int(self._trajectory.get_subscription_count())

    def halt(self) -> None:
        """Publish a stop."""
        self._trajectory.publish(STOP)

    def record(self, output: Path) -> BackgroundRecorder:
        """Begin to record what is measured."""
        return BackgroundRecorder(self._node, output, RECORDED)
