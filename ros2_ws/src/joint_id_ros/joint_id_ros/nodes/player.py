"""Node `player`: plays a bag with its recorded timing, for the same nodes as a live robot."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from rosbags.interfaces import Connection, QosDurability
from rosgraph_msgs.msg import Clock as ClockMessage

from joint_id_core.errors import JointIdError
from joint_id_core.formats.opened_bag import opened
from joint_id_ros.conversions import to_stamp
from joint_id_ros.diagnostics import Diagnostics, Health
from joint_id_ros.message_types import message_class
from joint_id_ros.options.player import PlayerOptions
from joint_id_ros.parameters import declare, read
from joint_id_ros.qos import CLOCK, LATEST, REPLAY
from joint_id_ros.running import EndedEarlyError

TICK_S = 0.002  # period of the checks for messages that are due
SLICE_S = 0.02  # longest duration of one tick, so that signals and services are served
LINGER_S = 60.0  # longest wait at the end for slow readers
CLOCK_S = 0.01  # shortest time between two messages on /clock, in s of wall time

# Topics that joint_id's nodes compute again from the bag, or that belong to the recorded run.
COMPUTED = ("joint_samples", "joint_params", "diagnostics", "clock", "rosout", "parameter_events", "transition_event")


class PlayerNode(Node):
    """Publishes the recorded bytes; it waits for slow readers and loses no samples."""

    def __init__(self) -> None:
        super().__init__("player")
        self.finished, self.streams = Future(), None
        declare(self, PlayerOptions)
        self._options = read(self, PlayerOptions)
        self._stack = ExitStack()
        self._reader = self._stack.enter_context(opened(Path(self._options.bag)))
        connections = self._chosen()
        self._outputs = {c.id: self._advertise(c) for c in connections}
        self._must_match = [self._outputs[c.id] for c in connections if not _latched(c)]
        self._messages = self._bytes(connections)
        self._next: tuple[Publisher, int, bytes] | None = None
        self._time_output = self.create_publisher(ClockMessage, "/clock", CLOCK) if self._options.clock else None
        self._clock_told = -math.inf
        self._created = time.monotonic()
        self._listened: float | None = None  # when the first subscriber was there
        self._begun: float | None = None
        self._ended: float | None = None
        self._bag_start = self._newest_ns = self._reader.start_time
        self._published = self._held_up = 0
        self._diagnostics = Diagnostics(self, self._health)
        self.create_timer(TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _chosen(self) -> list[Connection]:
        """Return the topics to play."""
        wanted = {name.strip("/") for name in self._options.topics}
        there = {c.topic.strip("/"): c for c in self._reader.connections}
        for name in wanted - set(there):
            raise JointIdError(f"{self._options.bag} has no topic {name}: it has {', '.join(sorted(there))}")
        chosen = [c for n, c in there.items() if (n in wanted if wanted else n.rsplit("/", 1)[-1] not in COMPUTED)]
        if not any(c.msgcount for c in chosen):
            raise JointIdError(
                f"{self._options.bag}: nothing to play on {', '.join(sorted(there))}: see parameter topics"
            )
        return chosen

    def _advertise(self, connection: Connection) -> Publisher:
        """Create the publisher of a recorded topic; its name is made relative, so that namespaces and remaps apply."""
        try:
            kind = message_class(connection.msgtype)
            return self.create_publisher(kind, connection.topic.lstrip("/"), LATEST if _latched(connection) else REPLAY)
        except (InvalidTopicNameException, JointIdError) as error:
            raise JointIdError(f"{self._options.bag}, topic {connection.topic}: {error}") from None

    def _bytes(self, connections: list[Connection]) -> Iterator[tuple[Publisher, int, bytes]]:
        """Yield publisher, recorded instant in ns and bytes of each message, in order of time."""
        for connection, instant_ns, data in self._reader.messages(connections):
            yield self._outputs[connection.id], instant_ns, bytes(data)

    def _tick(self) -> None:
        now = time.monotonic()
        if self._begun is None:
            unmatched = [p.topic_name for p in self._must_match if not p.get_subscription_count()]
            if self._waits(now, len(unmatched)):
                return
            if unmatched:
                self.get_logger().warning(f"playing although nobody listens on {', '.join(unmatched)}")
            self._begun = now
            self._diagnostics.started()
        try:
            done = self._play(now)
        except Exception as error:  # the decoder raises many kinds of errors on a damaged bag
            if not isinstance(error, JointIdError):
                what = " ".join(str(error).split()) or type(error).__name__
                kind = EndedEarlyError if self._published else JointIdError
                error = kind(f"{self._options.bag}: damaged after {self._published} messages ({what})")
            self.finished.set_result(error)
            return
        if done:
            self._end(now)

    def _waits(self, now: float, unmatched: int) -> bool:
        """Return whether to wait on for subscribers; the wait for the others begins when the first one is there."""
        if unmatched < len(self._must_match):
            self._listened = self._listened or now
        since = self._listened or self._created
        longest = self._options.wait_s if self._listened else max(self._options.wait_s, self._options.wait_first_s)
        return unmatched > 0 and now - since < longest

    def _end(self, now: float) -> None:
        """Finish when the readers have all messages; checked at every tick, so that signals are served meanwhile."""
        self._ended = self._ended or now
        acknowledged = all(p.wait_for_all_acked(Duration()) for p in self._must_match)
        if not acknowledged and now - self._ended < LINGER_S:
            return
        if not acknowledged:
            self.get_logger().warning(f"a reader has not taken its last messages in {LINGER_S:g} s")
        self.get_logger().info(f"played {self._published} messages of {self._options.bag}")
        self.finished.set_result(None)

    def _play(self, now: float) -> bool:
        """Publish the messages that are due; return True at the end of the bag."""
        assert self._begun is not None
        due = self._bag_start + int((now - self._begun) * self._options.rate * 1e9)
        while time.monotonic() - now < SLICE_S:
            if self._next is None and (message := next(self._messages, None)) is None:
                self._tell_time(math.inf, self._newest_ns)  # always, so that /clock ends at the end of the bag
                return True
            elif self._next is None:
                self._next = message
            publisher, instant_ns, data = self._next  # type: ignore[misc]  # set above
            if self._options.rate and instant_ns > due:
                self._tell_time(now, due)
                return False
            if not self._publish(publisher, data):
                return False
            self._next, self._newest_ns = None, instant_ns
            self._tell_time(now, instant_ns)
        return False

    def _publish(self, publisher: Publisher, data: bytes) -> bool:
        """Publish a message; return False if slow readers left no room, so that the caller must try again."""
        try:
            publisher.publish(data)
        except RuntimeError:  # rclpy's RCLError, after the middleware has waited for room
            self._held_up += 1
            return False
        self._published += 1
        return True

    def _tell_time(self, now: float, instant_ns: int) -> None:
        """Publish the time of the bag, unless it was published less than `CLOCK_S` before `now`."""
        if self._time_output is not None and now - self._clock_told >= CLOCK_S:
            self._clock_told = now
            self._time_output.publish(ClockMessage(clock=to_stamp(instant_ns)))

    def _health(self) -> Health:
        values = {"bag": self._options.bag, "published": self._published, "held up": self._held_up}
        share = 100.0 * self._published / max(1, self._reader.message_count)
        state = "waiting for subscribers" if self._begun is None else f"played {share:.0f} %"
        return Health(message=state, values=values)

    def close(self) -> None:
        """Close the bag."""
        self._messages = iter(())
        self._stack.close()


def _latched(connection: Connection) -> bool:
    """Return whether late subscribers get the last message of this topic."""
    profiles = getattr(connection.ext, "offered_qos_profiles", [])
    return any(p.durability == QosDurability.TRANSIENT_LOCAL for p in profiles)
