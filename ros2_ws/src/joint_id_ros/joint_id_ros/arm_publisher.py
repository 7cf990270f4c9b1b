"""What is known of an arm on /joint_params and /payload."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from joint_id_core.arm.joint_estimates import joint_estimates
from joint_id_core.formats.topics import SAMPLES
from joint_id_core.results.estimate import Estimate, Status
from joint_id_msgs.msg import ArmPayload
from joint_id_ros.arm_knowledge import ArmKnowledge
from joint_id_ros.arm_payload import to_payload
from joint_id_ros.estimate_bytes import to_values
from joint_id_ros.latest_estimates import LatestEstimates
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.presence import GONE_S
from joint_id_ros.qos import LATEST
from joint_id_ros.silence import Silence

GONE = f"no samples of all joints for {GONE_S:.0f} s: what is known of the arm waits until they return"


class ArmPublisher:
    """Publishes what is known, and remembers the newest good estimate of each joint.

    What was published of an arm whose samples do not come any more is taken back until they return.

    Attributes:
        gone: whether samples of all joints came, and do not come any more.
    """

    def __init__(self, node: ManagedNode, clock_s: Callable[[], float]) -> None:
        """Publish nothing yet; by `clock_s`, in s, samples are gone: if it stands, the last estimates stay."""
        self._latest = LatestEstimates(node)
        self._absence, self.gone = Silence(clock_s), False
        self._seen = 0  # stretches of samples
        self._payload = node.create_lifecycle_publisher(ArmPayload, "payload", LATEST)
        self._good: dict[str, Estimate] = {}

    def forget(self) -> None:
        """Forget the good estimates."""
        self._good.clear()

    def publish(self, arm: ArmKnowledge, origin_ns: int) -> None:
        """Publish what is known; times of the arm count from `origin_ns`."""
        self.gone = False
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

    def look(self, arm: ArmKnowledge) -> bool:
        """Look whether samples come; return whether what was published was taken back as they do not."""
        absent_s = self._absence.look(arm.stretches != self._seen or not arm.stretches)
        self._seen = arm.stretches
        if self.gone or not absent_s > GONE_S:
            return False
        self.gone = True
        self.take_back(arm.regressor.last_link, f"{GONE[0].upper()}{GONE[1:]}.")
        return True

    def take_back(self, link: str, why: str) -> None:
        """Take back what was published of the joints and of what a link carries, and say why."""
        self._latest.begin({})
        self._payload.publish(ArmPayload(link=link, message=why))

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
