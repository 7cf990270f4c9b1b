"""Node `emulated_motion`: lets an emulated robot follow trajectories. It reaches no robot on a network."""

from __future__ import annotations

import tempfile
from pathlib import Path

from rclpy.node import Node
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

from joint_id_core.design.files import write
from joint_id_core.emulator.command_socket import give
from joint_id_core.errors import JointIdError
from joint_id_ros.diagnostics import Diagnostics
from joint_id_ros.options.emulated_motion import EmulatedMotionOptions
from joint_id_ros.parameters import declare, read
from joint_id_ros.streams import Streams
from joint_id_ros.trajectories import QOS, TOPIC, from_message


class EmulatedMotionNode(Node):
    """Hands every JointTrajectory to the emulator; one without points stops the robot."""

    def __init__(self) -> None:
        super().__init__("emulated_motion")
        self.finished = Future()
        self.streams: Streams | None = None
        declare(self, EmulatedMotionOptions)
        self._socket = Path(read(self, EmulatedMotionOptions).socket)
        self._diagnostics = Diagnostics(self)
        self.create_subscription(JointTrajectory, TOPIC, self._on_trajectory, QOS)

    def close(self) -> None:
        """Nothing is open."""

    def _on_trajectory(self, message: JointTrajectory) -> None:
        try:
            answer = self._follow(message) if message.points else give(self._socket, "stop")
        except JointIdError as error:
            self._diagnostics.problem("refused", f"nothing moves: {error}")
            return
        self.get_logger().info(answer)

    def _follow(self, message: JointTrajectory) -> str:
        trajectory = from_message(message)
        with tempfile.TemporaryDirectory(prefix="joint_id_") as folder:
            file = Path(folder) / "trajectory.csv"
            write(trajectory, file)
            return give(self._socket, f"follow {file}")
