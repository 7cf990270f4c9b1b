"""What is known of an arm on /joint_params and /payload."""

from __future__ import annotations

from collections.abc import Mapping

from joint_id_core.arm.joint_estimates import joint_estimates
from joint_id_core.formats.topics import SAMPLES
from joint_id_core.results.estimate import Estimate, Status
from joint_id_msgs.msg import ArmPayload
from joint_id_ros.arm_knowledge import ArmKnowledge
from joint_id_ros.arm_payload import to_payload
from joint_id_ros.estimate_bytes import to_values
from joint_id_ros.latest_estimates import LatestEstimates
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.qos import LATEST


class ArmPublisher:
    """Publishes what is known, and remembers the newest good estimate of each joint."""

    def __init__(self, node: ManagedNode) -> None:
        self._latest = LatestEstimates(node)
        self._payload = node.create_lifecycle_publisher(ArmPayload, "payload", LATEST)
        self._good: dict[str, Estimate] = {}

    def forget(self) -> None:
        """Forget the good estimates."""
        self._good.clear()

    def publish(self, arm: ArmKnowledge, origin_ns: int) -> None:
        """Publish what is known; times of the arm count from `origin_ns`."""
        newest = joint_estimates(arm.follower, arm.regressor, SAMPLES.name)
        for name, found in newest.items():
            if found.converged:
                self._good[name] = newest[name] = found.updated(message=found.message + arm.scale)
        self._send(arm, newest, origin_ns)

    def publish_restored(self, arm: ArmKnowledge, now_ns: int) -> None:
        """Publish what is known of an earlier run, before the first motion of this one."""
        text, newest = f"Restored from {arm.state}: not tested by new motion yet.", {}
        for name, found in joint_estimates(arm.follower, arm.regressor, SAMPLES.name).items():
            self._good[name] = found.updated(status=Status.CONVERGED)
            newest[name] = found.updated(status=Status.TOO_SHORT, message=text, notes=(text,))
        self._send(arm, newest, now_ns)

    def wait(self) -> None:
        """Wait until the readers have what was published."""
        self._latest.wait()

    def _send(self, arm: ArmKnowledge, newest: Mapping[str, Estimate], origin_ns: int) -> None:
        for name, found in newest.items():
            self._latest.put(name, to_values(name, found, self._good.get(name), origin_ns))
        self._latest.publish()
        message = to_payload(arm.follower, arm.regressor, origin_ns)
        message.message += arm.scale if message.carries else ""
        self._payload.publish(message)
