"""Node `arm_identifier`: identifies a whole arm, and what it carries, from aligned samples of all its joints."""

from __future__ import annotations

from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from std_srvs.srv import Trigger

from joint_id_core.alignment.joining import StampOrder
from joint_id_core.alignment.source_watch import RATE, SourceEvent
from joint_id_core.arm.description import Description
from joint_id_core.arm.joint_estimates import fault_text
from joint_id_core.arm.urdf import loaded_pinocchio
from joint_id_core.errors import JointIdError
from joint_id_core.formats.topics import SAMPLES
from joint_id_msgs.msg import JointSamples
from joint_id_ros.arm_knowledge import ArmKnowledge
from joint_id_ros.arm_publisher import GONE, ArmPublisher
from joint_id_ros.description_source import DescriptionSource
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.ending import SILENT_S, Ending
from joint_id_ros.lifecycle import ManagedNode
from joint_id_ros.options.arm_identifier import ArmIdentifierOptions
from joint_id_ros.options.reading import ReadingOptions
from joint_id_ros.parameters import read
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.samples import to_recordings
from joint_id_ros.silence import STEP_S
from joint_id_ros.sources import Sources
from joint_id_ros.streams import Streams

PACE_S = 0.1  # time between two readings of the samples
CHECK_S = STEP_S  # period of the checks whether there are samples, or the node to end with has gone


class ArmIdentifierNode(ManagedNode):
    """Follows an arm: publishes joint_params for every joint, and payload."""

    def __init__(self, **how: Any) -> None:
        super().__init__("arm_identifier", ArmIdentifierOptions, ReadingOptions, **how)
        self._options = ArmIdentifierOptions()
        self._arm: ArmKnowledge | None = None
        self._sources: Sources | None = None
        self._description: DescriptionSource | None = None
        self._publisher = ArmPublisher(self, self._clock_s)
        self._ending = Ending(self)
        self._diagnostics = Diagnostics(self, self._health, "joint_samples")
        for name in ("save", "reset"):
            self.create_service(Trigger, f"~/{name}", partial(self._answer, name))
        self._forget_run()
        self._silent = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(CHECK_S, self._on_timer, clock=steady)
        self.start_soon()

    def prepare(self) -> None:
        """Check the parameters, and read the description if it is in a file."""
        self._options = read(self, ArmIdentifierOptions)
        loaded_pinocchio()
        if self._options.urdf:
            Description.read(self._options.urdf, self._options.base_gravity)
        if self._description is not None:
            self._description.close()
        self._description = None

    def begin(self) -> None:
        """Subscribe to the samples; read the description, or subscribe to it."""
        reliability, topics = read(self, ReadingOptions).reliability, {SAMPLES.name: JointSamples}
        self._sources = Sources(self, topics, reliability, self._diagnostics, self._on_source)
        self.streams = Streams(self, topics, self._on_samples, self._sources, reliability, self._on_batch, PACE_S)
        if self._description is None:  # else what is known goes on, after a pause
            self._description = DescriptionSource(self, self._options, self._take, self._diagnostics.problem)
        self.get_logger().info("identifying the arm")

    def close(self) -> None:
        """End the subscriptions to samples, and write what is known."""
        for part in (self.streams, self._sources):
            if part is not None:
                part.close()
        if self._arm is not None:
            self._arm.flush()
        self.streams = self._sources = None

    def _take(self, description: Description | None) -> None:
        if self._arm is not None:
            self._publisher.take_back(self._arm.regressor.last_link, "The arm has another description.")
            self._arm.close()
        self._arm = None
        if description is None:
            return
        self._arm = ArmKnowledge(description, self._options, self._diagnostics.problem)
        self._forget_run()
        if self._arm.follower.belief is not None and self.streams is not None:
            self._publisher.publish_restored(self._arm, self.get_clock().now().nanoseconds)

    # --- samples

    def _forget_run(self) -> None:
        self._order = StampOrder()
        self._origin_ns: int | None = None
        self._waiting: list[RawMessage] = []
        self._publisher.forget()

    def _on_samples(self, topic: str, message: RawMessage) -> None:
        self._silent = 0
        self._diagnostics.received(message.stamp_ns)
        try:
            if message.error is not None:
                raise message.error
            restart = self._order.restarts(SAMPLES.name, message.stamp_ns)
        except JointIdError as error:
            self._diagnostics.problem("message left out", str(error))
            return
        if restart:
            self._begin_anew(f"{SAMPLES.name}: time jumped back")
        self._waiting.append(message)

    def _on_source(self, topic: str, event: SourceEvent) -> None:
        if event.kind == RATE:
            self._begin_anew(event.text)

    def _begin_anew(self, why: str) -> None:
        self._diagnostics.problem("restart", f"{why}: a new run begins, with what is known of the arm")
        order = self._order
        self._forget_run()
        self._order = order
        if self._arm is not None:
            self._arm.begin()

    def _on_batch(self) -> None:
        messages, self._waiting = self._waiting, []
        if self._arm is None or not messages:
            return
        if self._origin_ns is None:
            self._origin_ns = messages[0].stamp_ns
        stretches = self._arm.stretches
        try:
            new = self._arm.add(to_recordings(messages, self._origin_ns, SAMPLES.name))
        except JointIdError as error:
            self._diagnostics.problem("samples left out", str(error))
            return
        if new or (self._publisher.gone and self._arm.stretches > stretches):
            self._publisher.publish(self._arm, self._origin_ns)

    # --- the rest

    def _answer(self, name: str, _: Any, response: Any) -> Any:
        try:
            if self._arm is None:
                raise JointIdError(self._missing())
            response.message, response.success = getattr(self._arm, name)(), True
            self._publisher.forget()
        except JointIdError as error:
            response.message, response.success = str(error), False
        self.get_logger().info(f"{name}: {response.message}")
        return response

    def _missing(self) -> str:
        """Return why there is no arm."""
        refused = "" if self._description is None else self._description.refused
        return refused or f"no description of the robot on {self._options.description_topic} yet"

    def _clock_s(self) -> float:
        """Return the time in s by which samples are gone; it stands where the last estimates shall stay."""
        return 0.0 if self.get_parameter("end_with").value else self.now_s()

    def _on_timer(self) -> None:
        if self._arm is not None and self.streams is not None and self._publisher.look(self._arm):
            self._diagnostics.problem("arm gone", GONE)
        self._silent += 1
        silent = self._silent * CHECK_S > SILENT_S and self._sources is not None and not self._sources.published
        if silent and self._ending.due(self.get_parameter("end_with").value, self._origin_ns is not None):
            self._publisher.wait()
            self.finished.set_result(None)

    def _health(self) -> Health:
        sources, arm = self._sources, self._arm
        if self.not_ready or sources is None:
            return Health(DiagnosticStatus.ERROR, self.not_ready or "stopped")
        if arm is None:
            return Health(DiagnosticStatus.WARN, self._missing())
        follower, (level, late) = arm.follower, sources.lateness
        text = "learning" if follower.belief is None else "at rest" if follower.rests else "identifying"
        text = "no samples" if self._publisher.gone else text
        values: dict[str, object] = {"arm": text, "motion [s]": f"{follower.motion:.1f}", "state file": arm.state}
        bad = [*sources.complaints, *late, *filter(None, [arm.problem])]
        bad += [f"the torque of {', '.join(follower.unexplained)} is not explained"] if follower.unexplained else []
        bad += [fault_text(follower.belief)] if follower.belief is not None and follower.belief.faults.texts else []
        return Health(max(level, DiagnosticStatus.WARN) if bad else level, "; ".join(bad) or text, values)
