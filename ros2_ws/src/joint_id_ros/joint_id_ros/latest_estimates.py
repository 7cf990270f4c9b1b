"""The newest estimate of every joint, on /joint_params."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from joint_id_msgs.msg import JointParams
from joint_id_ros.estimate_bytes import ParamsWriter, Values, by_field
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.qos import FLUSH, LATEST


class LatestEstimates:
    """Keeps the newest estimate of every joint and publishes all of them together; threads may call it.

    Every message holds all joints, so estimates that come together are published once.
    """

    def __init__(self, node: ManagedNode) -> None:
        self._publisher = node.create_lifecycle_publisher(JointParams, "joint_params", LATEST)
        self._estimates: dict[str, Values] = {}
        self._writer = ParamsWriter()
        self._published: dict[str, Values] = {}
        self._new = False
        self._lock = threading.Lock()  # of two messages, the newer one is published last

    def begin(self, estimates: Mapping[str, Values]) -> None:
        """Replace all estimates, and publish those."""
        self._estimates, self._new = dict(estimates), bool(estimates or self._estimates)
        self.publish()

    def put(self, joint: str, estimate: Values) -> None:
        """Take an estimate that `publish` will send."""
        self._estimates[joint], self._new = estimate, True

    def drop(self, joint: str) -> None:
        """Take back what was published of a joint."""
        self._new = self._estimates.pop(joint, None) is not None or self._new
        self.publish()

    def publish(self) -> None:
        """Publish, if there is anything new."""
        with self._lock:
            if self._new:
                self._new = False
                self._published = self._estimates.copy()
                self._publisher.publish(self._writer.write(self._published))

    def wait(self) -> None:
        """Wait until the readers have what was published."""
        self._publisher.wait_for_all_acked(FLUSH)

    @property
    def newest(self) -> dict[str, dict[str, Any]]:
        """What was published last, by joint and by field of JointEstimate."""
        return {joint: by_field(values) for joint, values in self._published.items()}
