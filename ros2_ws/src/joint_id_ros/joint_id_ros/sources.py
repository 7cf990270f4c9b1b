"""What a node knows of the publishers of its topics, in words for its diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from joint_id_core.alignment.source_watch import SILENT_S, SourceEvent, SourceWatch
from joint_id_core.data.instants import NANO
from joint_id_ros.diagnostics import Diagnostics
from joint_id_ros.options.reading import RELIABLE
from joint_id_ros.raw_messages import RawMessage

BEAT_S = 0.25  # period of the checks that this process runs at all
STALL_S = 0.5  # silence of these checks from which the process counts as stopped
BACKLOG_S = 30.0  # longest time that reading what has waited may take
LOOK_S = 1.0  # period of the looks at the graph
LATE_S = 0.5  # samples that wait longer until they are read are a warning ...
TOO_LATE_S = 2.0  # ... and then an error
SEQUENCE = "publication_sequence_number"  # what rclpy calls the number that a publisher gave a message


class Sources:
    """Watches the publishers of some topics; what happens is reported as problems."""

    def __init__(
        self,
        node: Node,
        topics: Collection[str],
        reliability: str,
        diagnostics: Diagnostics,
        changed: Callable[[str, SourceEvent], None],
        recorded: bool = False,
    ) -> None:
        """Start to watch; `changed` gets the topic and what happened on it; `recorded` messages may wait."""
        self._node, self._reliability, self._diagnostics, self._changed = node, reliability, diagnostics, changed
        self._recorded = recorded
        self._watches = {topic: SourceWatch(topic, count=partial(self._count, topic)) for topic in topics}
        self._complaints: list[str] = []
        self._foreign: dict[str, int] = {}  # messages of other publishers until the last look, by topic
        self._beat_s = self._looked_s = time.monotonic()
        self._stalled_s, self._stall_ended_s = 0.0, -BACKLOG_S
        self._timer = node.create_timer(BEAT_S, self._beat, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def usual(self, topic: str, messages: Sequence[RawMessage], infos: Sequence[Mapping[str, Any]]) -> bool:
        """Take messages that were read together into account, as `admit` does, if there is nothing odd about them.

        Otherwise return False: each of them must be given to `admit`.
        """
        watch = self._watches.get(topic)
        if watch is None or messages[0].table is not messages[-1].table:
            return watch is None
        stamps_ns = [message.stamp_ns for message in messages]
        waited_s = max(self._waited(infos[0]), self._waited(infos[-1]))
        usual = watch.usual(stamps_ns, messages[0].name, [info.get(SEQUENCE) for info in infos], waited_s)
        self._tell(topic, watch)
        return usual

    def admit(self, topic: str, message: RawMessage, info: Mapping[str, Any]) -> bool:
        """Take a message with its `info` from rclpy into account; return False if it must be left out.

        Messages of topics that are not watched are taken as they come.
        """
        watch = self._watches.get(topic)
        if watch is None:
            return True
        admitted = watch.admit(message.stamp_ns, message.name, info.get(SEQUENCE), self._waited(info))
        self._tell(topic, watch)
        return admitted

    def _waited(self, info: Mapping[str, Any]) -> float:
        """Return the time in s that a message waited until it was read."""
        arrived_ns = info.get("received_timestamp") or 0
        waited_s = (time.time_ns() - arrived_ns) / NANO if arrived_ns else 0.0
        return max(waited_s, self._stall(info.get("source_timestamp")))

    def _tell(self, topic: str, watch: SourceWatch) -> None:
        """Report what happened on a topic."""
        while watch.events:
            event = watch.events.popleft()
            self._diagnostics.problem(event.kind, event.text)
            self._changed(topic, event)

    def values(self) -> dict[str, object]:
        """Return values for the diagnostics, and begin a new period of `waited`."""
        found: dict[str, object] = {"waited [s]": f"{self.slowest_s:.3f}"}
        for topic, watch in self._watches.items():
            found |= {f"{topic}: lost by {who}": count for who, count in sorted(watch.lost.items())}
            if watch.foreign:
                found[f"{topic}: of another publisher"] = watch.foreign
            watch.slowest_s = 0.0
        return found

    @property
    def slowest_s(self) -> float:
        """Longest time that a message, if not recorded, waited until it was read, in s, since the last `values`."""
        return 0.0 if self._recorded else max(watch.slowest_s for watch in self._watches.values())

    @property
    def lateness(self) -> tuple[bytes, list[str]]:
        """Level of the diagnostics, and why, by the longest wait of a message until it was read."""
        if self.slowest_s <= LATE_S:
            return DiagnosticStatus.OK, []
        text = f"messages were read {self.slowest_s:.1f} s late: this computer has too much to do"
        return DiagnosticStatus.ERROR if self.slowest_s > TOO_LATE_S else DiagnosticStatus.WARN, [text]

    @property
    def complaints(self) -> list[str]:
        """What is wrong with the publishers now."""
        return list(self._complaints)

    @property
    def published(self) -> bool:
        """Whether any of the topics has a publisher."""
        return any(self._node.count_publishers(self._node.resolve_topic_name(topic)) for topic in self._watches)

    def close(self) -> None:
        """End the watch."""
        self._node.destroy_timer(self._timer)

    def _stall(self, sent_ns: int | None) -> float:
        """Return the time in s for which this process did not run just now, or when a message was sent."""
        now = time.monotonic()
        stalled = now - self._beat_s
        if stalled > STALL_S:
            return stalled
        since = now - self._stall_ended_s
        # A busy computer takes long to read what has waited. The publisher's clock may be another one.
        sent_before = sent_ns is not None and since < BACKLOG_S and time.time_ns() - sent_ns > since * NANO
        return self._stalled_s if since < SILENT_S or sent_before else 0.0

    def _beat(self) -> None:
        now = time.monotonic()
        stalled, self._beat_s = now - self._beat_s, now
        if stalled > STALL_S:
            self._stalled_s, self._stall_ended_s = stalled, now
        if now - self._looked_s >= LOOK_S:
            self._looked_s = now
            self._complaints = [text for topic in self._watches for text in self._look(topic)]

    def _look(self, topic: str) -> list[str]:
        """Look at the publishers of a topic; return what is wrong with them."""
        found, name = [], self._node.resolve_topic_name(topic)
        readable, unreadable = self._publishers(topic)
        watch = self._watches[topic]
        disturbed = watch.foreign > self._foreign.get(topic, 0) or watch.uncounted
        self._foreign[topic] = watch.foreign
        watch.publishers = len(readable)
        if len(readable) > 1 and disturbed:  # one that was killed stays in the graph for a while, but is silent
            names = ", ".join(sorted(p.node_name for p in readable))
            found.append(f"{name} has {len(readable)} publishers ({names}): one of them is read; end the others")
        if unreadable:
            names = ", ".join(sorted(p.node_name for p in unreadable))
            found.append(
                f"{name}: publisher {names} offers best effort and is not read, because this node asks for reliable: "
                "start this node with -p reliability:=best_effort"
            )
        return found

    def _count(self, topic: str) -> int:
        return len(self._publishers(topic)[0])

    def _publishers(self, topic: str) -> tuple[list[TopicEndpointInfo], list[TopicEndpointInfo]]:
        """The publishers of a topic that this node can read, and the ones that it cannot."""
        readable, unreadable = list[TopicEndpointInfo](), list[TopicEndpointInfo]()
        for publisher in self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic)):
            reliable = publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            (readable if reliable or self._reliability != RELIABLE else unreadable).append(publisher)
        return readable, unreadable
