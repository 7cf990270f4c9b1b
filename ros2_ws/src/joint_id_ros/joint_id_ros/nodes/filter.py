"""Node `filter`: raw joint signals in, aligned samples with velocities and accelerations out."""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

from joint_id_core.alignment.inputs import LINK_STATES, InputOptions
from joint_id_core.alignment.joining import Joiner
from joint_id_core.errors import JointIdError
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.filtering.streaming import FilteredSample, StreamingFilter
from joint_id_core.formats.topics import RAW
from joint_id_msgs.msg import JointSamples, MotorTorques, MotorVoltages
from joint_id_ros import conversions as convert
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.parameters import declare, read
from joint_id_ros.qos import STREAM_OUT
from joint_id_ros.streams import Streams

TOPICS = {t.name: t for t in RAW}
RELEASE_S = 0.2  # how often samples are looked for that wait for a topic in vain
TYPES = {t.__name__: t for t in (JointState, MotorVoltages, MotorTorques)}


class FilterNode(Node):
    """Joins the raw topics by stamp, passes them through the Butterworth differentiator, publishes joint_samples."""

    def __init__(self) -> None:
        super().__init__("filter")
        self.finished = Future()
        declare(self, InputOptions)
        declare(self, FilterOptions)
        self._input = read(self, InputOptions).for_topic(self.resolve_topic_name(LINK_STATES))
        self._filter = StreamingFilter(read(self, FilterOptions))
        self._joiner: Joiner[dict[str, convert.Row]] = Joiner([t.name for t in RAW], self._input.join_wait_s)
        self._joints: dict[str, None] = {}
        self._origin_ns: int | None = None
        self._published = self._silent_periods = 0
        self._diagnostics = Diagnostics(self, self._health, LINK_STATES)
        self._publisher = self.create_publisher(JointSamples, "joint_samples", STREAM_OUT)
        kinds = {topic.name: TYPES[topic.type.rsplit("/", 1)[-1]] for topic in RAW}
        self.create_timer(RELEASE_S, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._streams = Streams(self, kinds, self._on_message)

    def _on_message(self, name: str, message: Any) -> None:
        topic = TOPICS[name]
        self._silent_periods = 0
        stamp = convert.nanoseconds(message.header.stamp)
        if name == LINK_STATES:
            self._diagnostics.received(stamp)
        try:
            convert.check(topic, message)
            complete = self._joiner.add(topic.name, stamp, convert.rows(topic, message))
        except JointIdError as error:
            self._diagnostics.problem("message left out", str(error))
            return
        for stamp, parts in complete:
            self._push(stamp, parts)

    def _on_timer(self) -> None:
        """Give up waiting when no topic speaks. One silent period may only mean that this process was held up."""
        self._silent_periods += 1
        if self._silent_periods < 2:
            return
        for stamp, parts in self._joiner.release(idle=True):
            self._push(stamp, parts)

    def _push(self, stamp: int, parts: dict[str, dict[str, convert.Row]]) -> None:
        """Filter all joints at one instant."""
        if self._origin_ns is None:
            self._origin_ns = stamp
        for part in parts.values():
            self._joints.update(dict.fromkeys(part))
        channels: dict[str, np.ndarray] = {}
        for part in parts.values():
            for k, joint in enumerate(self._joints):
                for name, value in part.get(joint, {}).items():
                    channels.setdefault(name, np.full(len(self._joints), np.nan))[k] = value
        time = convert.seconds(stamp, self._origin_ns)
        for sample in self._filter.push(time, self._input.channels(channels)):
            self._publish(sample)
        while self._filter.events:
            self._diagnostics.problem("filter", self._filter.events.popleft())

    def _publish(self, sample: FilteredSample) -> None:
        assert self._origin_ns is not None
        joints = list(self._joints)[: len(next(iter(sample.channels.values())))]
        stamp = convert.instant(sample.time, self._origin_ns)
        self._publisher.publish(convert.to_samples(stamp, joints, sample.channels, sample.derived))
        self._published += 1

    def _health(self) -> Health:
        values = {
            "joints": ", ".join(self._joints),
            "effort": self._input.effort_source,
            "published": self._published,
            "filter latency [s]": f"{self._filter.latency:.4f}",
        }
        values |= {f"filter: {kind}": count for kind, count in self._filter.counts.items()}
        return Health(DiagnosticStatus.OK, "filtering", values)

    def close(self) -> None:
        """End the subscriptions."""
        self._streams.close()
