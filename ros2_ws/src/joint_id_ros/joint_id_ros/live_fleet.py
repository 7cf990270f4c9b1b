"""Many robots of a live page from what their nodes publish; robots are found by their topics."""

from __future__ import annotations

import time
from functools import partial

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from joint_id_core.pages.fleet import FleetView
from joint_id_core.pages.server import Query
from joint_id_msgs.msg import ArmPayload, JointParams
from joint_id_ros.live_joints import to_seen
from joint_id_ros.live_nodes import LiveNodes
from joint_id_ros.qos import LATEST

PARAMS, PAYLOAD = "joint_params", "payload"
KINDS = {PARAMS: JointParams, PAYLOAD: ArmPayload}
TYPES = {name: f"joint_id_msgs/msg/{kind.__name__}" for name, kind in KINDS.items()}


class LiveFleet:
    """Subscribes to joint_params and payload of every robot that appears in the graph."""

    def __init__(self, node: Node, nodes: LiveNodes) -> None:
        """Begin without robots; `nodes` knows the diagnostics."""
        self._node, self._nodes = node, nodes
        self._view = FleetView()
        self._followed: set[str] = set()  # topics
        self._new: dict[tuple[str, str], bytes] = {}  # newest messages that were not read yet, by robot and topic
        self._robots: list[str] = []

    def update(self) -> dict[str, object]:
        """Look for robots, read the newest messages, and return the rows of the page."""
        self._look()
        now, new, self._new = time.monotonic(), self._new, {}
        for (robot, name), data in new.items():
            message = deserialize_message(data, KINDS[name])
            if name == PARAMS:
                self._view.take(robot, {joint.joint: to_seen(joint) for joint in message.joints}, now)
            else:
                self._view.carries(robot, message.message, now)
        for robot in self._robots:
            self._view.nodes(robot, *self._nodes.worst(f"/{robot}/" if robot else "/"))
            self._view.there(robot, self._there(robot), now)
        return self._view.state(now)

    def joint(self, query: Query) -> dict[str, object]:
        """Return what is known of the joint `joint` of the robot `robot`."""
        return self._view.joint(query.get("robot", ""), query.get("joint", ""))

    def _look(self) -> None:
        """Subscribe to topics that are new."""
        for topic, types in self._node.get_topic_names_and_types():
            robot, _, name = topic.rpartition("/")
            if topic in self._followed or TYPES.get(name) not in types:
                continue
            self._followed.add(topic)
            robot = robot.strip("/")
            if name == PARAMS:
                self._robots.append(robot)
            self._node.create_subscription(KINDS[name], topic, partial(self._take, robot, name), LATEST, raw=True)

    def _take(self, robot: str, name: str, data: bytes) -> None:
        self._new[robot, name] = data

    def _there(self, robot: str) -> bool:
        """Whether a node publishes what is known of a robot, and is not silent."""
        topic = f"/{robot}/{PARAMS}" if robot else f"/{PARAMS}"
        names = [
            f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            for info in self._node.get_publishers_info_by_topic(topic)
        ]
        return any(not self._nodes.silent(name) for name in names)
