"""Checks of `joint-id doctor` that need ROS 2: its settings, our messages, and DDS between two nodes."""

from __future__ import annotations

import os
import time

from joint_id_core.doctor import Check

PATIENCE_S = 5.0
TOPIC = "joint_id_doctor"


def checks() -> list[Check]:
    """Return what was found; nodes are started on the domain of the environment, and ended."""
    import rclpy  # noqa: F401  # an ImportError is said by the caller

    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    middleware = os.environ.get("RMW_IMPLEMENTATION", "the default middleware")
    found = [Check("ROS 2", True, f"rclpy is there; domain {domain}, {middleware}")]
    try:
        from joint_id_msgs.msg import JointParams
    except ImportError as error:
        return [*found, Check("messages", False, str(error), "colcon build in ros2_ws, and source its setup.bash")]
    return [*found, Check("messages", True, "joint_id_msgs"), _loopback(JointParams)]


def _loopback(kind: type) -> Check:
    """Send one message from a node to another one."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor

    from joint_id_ros.qos import LATEST

    got: list[object] = []
    context, begun = Context(), time.perf_counter()
    rclpy.init(context=context)
    try:
        reader, writer = (rclpy.create_node(f"{TOPIC}_{n}", context=context) for n in ("reader", "writer"))
        reader.create_subscription(kind, TOPIC, got.append, LATEST)
        writer.create_publisher(kind, TOPIC, LATEST).publish(kind())
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(reader)
        while not got and time.perf_counter() - begun < PATIENCE_S:
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
    finally:
        rclpy.shutdown(context=context)
    taken = time.perf_counter() - begun
    if got:
        return Check("DDS", True, f"a message went from node to node, {taken:.1f} s with start and discovery")
    return Check(
        "DDS", False, f"no message went from one node to another in {PATIENCE_S:g} s",
        "sudo ip link set lo multicast on, look at the firewall, or export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
    )  # fmt: skip
