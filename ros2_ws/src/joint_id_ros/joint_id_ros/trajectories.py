"""Trajectories as `trajectory_msgs/JointTrajectory`, in the convention of joint_trajectory_controller."""

from __future__ import annotations

from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from joint_id_core.data.instants import NANO
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError

TOPIC = "joint_trajectory"
QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
FIELDS = ("positions", "velocities", "accelerations")
STOP = JointTrajectory()  # without points: whoever follows a trajectory stops


def to_message(trajectory: Trajectory) -> Any:
    """Return the message of a trajectory; its stamp is zero, which means at once."""
    message = JointTrajectory(joint_names=list(trajectory.names))
    rows = (trajectory.time, trajectory.position, trajectory.velocity, trajectory.acceleration)
    for time, *values in zip(*(row.tolist() for row in rows), strict=True):
        sec, nanosec = divmod(round(time * NANO), NANO)
        point = JointTrajectoryPoint(time_from_start=Duration(sec=sec, nanosec=nanosec))
        point.positions, point.velocities, point.accelerations = values
        message.points.append(point)
    return message


def from_message(message: Any) -> Trajectory:
    """Return the trajectory of a message that has points.

    Raises:
        JointIdError: a point without positions, velocities or accelerations of every joint; what `Trajectory` raises.
    """
    names = tuple(message.joint_names)
    for k, point in enumerate(message.points):
        for field in FIELDS:
            if len(getattr(point, field)) != len(names):
                raise JointIdError(
                    f"point {k} has {len(getattr(point, field))} {field} for {len(names)} joints: give positions, "
                    "velocities and accelerations of every joint"
                )
    instants = [point.time_from_start.sec + point.time_from_start.nanosec / NANO for point in message.points]
    return Trajectory(names, np.array(instants), *(np.array([getattr(p, f) for p in message.points]) for f in FIELDS))
