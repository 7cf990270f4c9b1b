"""The description of the robot: from a file, or from a topic, on which another one may follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from rclpy.node import Node
from rclpy.subscription import Subscription
from std_msgs.msg import String

from joint_id_core.arm.description import Description
from joint_id_core.arm.urdf import loaded_pinocchio
from joint_id_core.errors import JointIdError
from joint_id_ros.qos import LATEST


class Place(Protocol):
    """Where a description is: options of a node."""

    @property
    def urdf(self) -> str:
        """A file; "" if it is on the topic."""

    @property
    def description_topic(self) -> str:
        """The topic; "" if there is none."""

    @property
    def base_gravity(self) -> tuple[float, ...]:
        """Gravity in the frame of the robot's base, in m/s^2."""


class DescriptionSource:
    """Hands over every description that can be used.

    Attributes:
        refused: why the newest one cannot be used; "" if it can, or there is none yet.
        name: of the file or the topic.
    """

    def __init__(
        self,
        node: Node,
        place: Place,
        take: Callable[[Description | None], None],
        tell: Callable[[str, str], None],
    ) -> None:
        """Read the file, or subscribe to the topic.

        Args:
            node: that is told of it.
            place: where it is; without one, there is none.
            take: takes a description; None ends the use of the one before.
            tell: takes the kind and the text of a problem.

        Raises:
            JointIdError: a file that is no description of a robot, or Pinocchio is not installed.
        """
        self.refused = self._text = ""
        self._node, self._place, self._take, self._tell = node, place, take, tell
        self._heard: Subscription | None = None
        self.name = place.urdf
        if place.urdf:
            take(Description.read(place.urdf, place.base_gravity))
        elif place.description_topic:
            loaded_pinocchio()  # before samples come
            self.name = node.resolve_topic_name(place.description_topic)
            self._heard = node.create_subscription(String, place.description_topic, self._on_description, LATEST)

    def _on_description(self, message: String) -> None:
        if message.data == self._text:
            return
        self._text, self.refused = message.data, ""
        self._take(None)
        try:
            self._take(Description(message.data, self.name, self._place.base_gravity))
        except JointIdError as error:
            self.refused = str(error)
            self._tell("description", self.refused)

    def close(self) -> None:
        """Read no more descriptions."""
        if self._heard is not None:
            self._node.destroy_subscription(self._heard)
        self._heard = None
