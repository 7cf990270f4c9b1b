"""Node `filter`: converts raw joint signals to aligned samples with velocities and accelerations."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

from joint_id_core.alignment.aligner import AlignedSamples, Aligner, Columns
from joint_id_core.alignment.inputs import LINK_STATES, InputOptions
from joint_id_core.alignment.source_watch import RATE, SourceEvent
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.formats.topics import CONDITIONS, RAW
from joint_id_msgs.msg import JointSamples, MotorTorques, MotorVoltages, RobotSignals
from joint_id_ros.arm_load import ArmLoad
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.ending import SILENT_S, Ending
from joint_id_ros.options.load import LoadOptions
from joint_id_ros.options.reading import FilterReadingOptions
from joint_id_ros.parameters import declare, read
from joint_id_ros.qos import FLUSH, REPLAY, STREAM_OUT
from joint_id_ros.raw_messages import RawMessage
from joint_id_ros.samples import SamplesWriter
from joint_id_ros.sources import Sources
from joint_id_ros.streams import Streams

SLICE_S = 0.02  # longest time of publishing at once, so that signals and services are served
RELEASE_S = 0.2  # period of the checks for samples that wait for a silent topic
TYPES = {t.__name__: t for t in (JointState, MotorVoltages, MotorTorques, RobotSignals)}
KINDS = {topic.name: TYPES[topic.type.rsplit("/", 1)[-1]] for topic in (*RAW, CONDITIONS)}


class FilterNode(Node):
    """Joins the raw topics by stamp, passes them through the Butterworth differentiator, publishes joint_samples."""

    def __init__(self, **how: Any) -> None:
        super().__init__("filter", **how)
        self.finished = Future()
        declare(self, InputOptions)
        declare(self, FilterOptions)
        declare(self, LoadOptions)
        declare(self, FilterReadingOptions)
        self._input = read(self, InputOptions).for_topic(self.resolve_topic_name(LINK_STATES))
        options = read(self, FilterOptions)
        self._aligner = Aligner(self._input, options)
        self._published = self._silent_periods = 0
        self._heard = False
        self._diagnostics = Diagnostics(self, self._health, LINK_STATES)
        tell = self._diagnostics.problem
        self._load = ArmLoad(self, read(self, LoadOptions), self._input, options.max_gap, tell)
        self._reading = read(self, FilterReadingOptions)
        qos = REPLAY if self._reading.recorded else STREAM_OUT
        self._publisher = self.create_publisher(JointSamples, "joint_samples", qos)
        self._writer, self._outbox = SamplesWriter(), deque[bytes]()
        self._ending = Ending(self)
        watched = [topic.name for topic in RAW]
        reliability, recorded = self._reading.reliability, self._reading.recorded
        self._sources = Sources(self, watched, reliability, self._diagnostics, self._on_source, recorded)
        self.streams: Streams | None = None
        self.create_timer(RELEASE_S, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._begin_when_heard()

    def _begin_when_heard(self) -> None:
        """Subscribe as soon as enough subscribers listen to what comes out."""
        if self.streams is None and self._publisher.get_subscription_count() >= self._reading.wait_subscribers:
            how, begun = self._reading.reliability, self._sources
            self.streams = Streams(self, KINDS, self._on_message, begun, how, self._on_batch, ready=self._sent)

    def _on_message(self, topic: str, message: RawMessage) -> None:
        if topic != CONDITIONS.name:
            self._silent_periods, self._heard = 0, True
        elif message.name and not message.channels:
            return  # it holds other signals
        if topic == LINK_STATES:
            self._diagnostics.received(message.stamp_ns)
        try:
            if message.error is not None:
                raise message.error
            self._aligner.join(topic, message.stamp_ns, Columns(message.name, message.channels))
        except JointIdError as error:
            self._diagnostics.problem("message left out", str(error))

    def _on_batch(self) -> None:
        self._publish(self._aligner.align())

    def _on_source(self, topic: str, event: SourceEvent) -> None:
        if topic == LINK_STATES and event.kind == RATE:
            self._begin_anew("another sampling rate")

    def _on_timer(self) -> None:
        """Release waiting samples after two silent periods; a single one may be a delay of this process."""
        self._begin_when_heard()
        self._silent_periods = self._silent_periods + 1 if self._sent() else 0  # it does not read before
        if self._silent_periods >= 2:
            self._publish(self._aligner.release())
        silent = self._silent_periods * RELEASE_S > SILENT_S and not self._aligner.waiting
        if self._ending.due(self._reading.end_with, self._heard) and silent and not self._sources.published:
            self._begin_anew("the samples end")
            if (self._sent() and self._publisher.wait_for_all_acked(FLUSH)) or not self._reading.recorded:
                self.finished.set_result(None)

    def _begin_anew(self, why: str) -> None:
        """Publish the samples that wait for later ones, and begin anew."""
        self._publish(self._aligner.new_rate(why))
        self._send(self._load.release())

    def _publish(self, aligned: list[AlignedSamples]) -> None:
        self._send(self._load.add(aligned))
        while self._aligner.filter.events:
            self._diagnostics.problem("filter", self._aligner.filter.events.popleft())

    def _send(self, done: list[AlignedSamples]) -> None:
        for samples in done:
            self._outbox.extend(self._writer.write(samples))
            self._published += len(samples.instants_ns)
        self._sent()

    def _sent(self) -> bool:
        """Publish what waits; return whether all of it is published: slow readers of a recording leave no room."""
        end = time.monotonic() + SLICE_S
        while self._outbox and time.monotonic() < end:
            try:
                self._publisher.publish(self._outbox[0])
            except RuntimeError:  # rclpy's RCLError, after the middleware has waited for room
                return False
            self._outbox.popleft()
        return not self._outbox

    def _health(self) -> Health:
        values: dict[str, object] = {
            "joints": ", ".join(self._aligner.joints),
            "effort": self._input.effort_source,
            "published": self._published,
            "filter latency [s]": f"{self._aligner.filter.latency + self._load.latency:.4f}",
        }
        values |= self._load.values
        values |= {f"filter: {kind}": count for kind, count in self._aligner.filter.counts.items()}
        if self.streams is None:
            text = f"waiting until {self._reading.wait_subscribers} subscribers listen on joint_samples"
            return Health(DiagnosticStatus.WARN, text, values)
        level, late = self._sources.lateness
        values |= self._sources.values()
        bad = [*self._sources.complaints, *late, *filter(None, [self._load.complaint])]
        return Health(max(level, DiagnosticStatus.WARN) if bad else level, "; ".join(bad) or "filtering", values)

    def close(self) -> None:
        """End the subscriptions."""
        if self.streams is not None:
            self.streams.close()
