"""The newest estimate of every joint, on /joint_params."""

from __future__ import annotations

import threading
from collections.abc import Mapping

from joint_id_msgs.msg import JointEstimate, JointParams
from joint_id_ros.conversions import to_params_message
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.qos import FLUSH, LATEST


class LatestEstimates:
    """Keeps the newest message of every joint and publishes all of them together; threads may call it.

    A message of six joints takes a millisecond, so estimates that come together are published once.
    """

    def __init__(self, node: ManagedNode) -> None:
        self._publisher = node.create_lifecycle_publisher(JointParams, "joint_params", LATEST)
        self._messages: dict[str, JointEstimate] = {}
        self._new = False
        self._lock = threading.Lock()  # of two messages, the newer one is published last

    def begin(self, messages: Mapping[str, JointEstimate]) -> None:
        """Replace all messages."""
        self._messages, self._new = dict(messages), bool(messages or self._messages)

    def put(self, joint: str, message: JointEstimate) -> None:
        """Take a message that `publish` will send."""
        self._messages[joint], self._new = message, True

    def drop(self, joint: str) -> None:
        """Take back what was published of a joint."""
        self._new = self._messages.pop(joint, None) is not None or self._new

    def publish(self) -> None:
        """Publish, if there is anything new."""
        with self._lock:
            if self._new:
                self._new = False
                self._publisher.publish(to_params_message(self.messages))

    def wait(self) -> None:
        """Wait until the readers have what was published."""
        self._publisher.wait_for_all_acked(FLUSH)

    @property
    def messages(self) -> dict[str, JointEstimate]:
        """The newest message of each joint."""
        return self._messages.copy()
