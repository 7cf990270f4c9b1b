"""Subscriptions to streams of samples that are read in batches.

rclpy's executor needs 0.3 to 0.6 ms for every wake-up, mostly for the services that every node has, and delivers one
message per topic. At 500 Hz with three topics this takes half a core. So the main loop of the process (`running.py`)
reads streams itself, at fixed intervals, and the executor never sees them. Messages are taken as bytes, because rclpy
needs 0.1 ms to make an object of a message.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from itertools import repeat
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.subscription import Subscription

from joint_id_core.data.instants import NANO
from joint_id_core.formats.topics import CONDITIONS, RAW, SAMPLES
from joint_id_ros.options.reading import RELIABLE
from joint_id_ros.qos import LOSSY_IN, STREAM_IN
from joint_id_ros.raw_messages import RawMessage, Reader
from joint_id_ros.sources import Sources

Taken = tuple[bytes, Mapping[str, Any]]  # a message, and what rclpy says of its way here

READ_S = 0.01  # time between two readings: small compared with the lag of the filter and the hop of the identifier
FAST = 1.5  # ratio of the time in the samples to the real time from which a recording is played fast
BATCH = 500  # most messages per topic and reading, so that timers and services are served in between


class Streams:
    """Subscribes to topics and passes their messages to one callback.

    The messages of one topic come in the order in which they were published. Messages of different topics come in the
    order of their stamps, so that no topic is ahead only because it was read first.

    Attributes:
        read_s: time until the next reading is due.
    """

    def __init__(
        self,
        node: Node,
        topics: Mapping[str, Any],
        callback: Callable[[str, RawMessage], None],
        sources: Sources,
        reliability: str,
        end_of_batch: Callable[[], None] = lambda: None,
        pace_s: float = READ_S,
        ready: Callable[[], bool] = lambda: True,
    ) -> None:
        """Subscribe.

        Args:
            node: the node that subscribes.
            topics: message classes by topic name, of topics in `formats.topics`.
            callback: gets the topic's name and the message.
            sources: is told of every message, and says which ones are left out.
            reliability: as in `ReadingOptions`.
            end_of_batch: called after the last of the messages that were read together.
            pace_s: time between two readings; it is `READ_S` while a recording is played fast.
            ready: whether to read now; what is not read holds reliable publishers that keep everything up.
        """
        self.read_s = self._pace_s = pace_s
        self._newest_ns, self._ready = 0, ready
        self._node, self._callback, self._sources, self._end_of_batch = node, callback, sources, end_of_batch
        self._readers = {t.name: Reader(t, topics[t.name]) for t in (*RAW, CONDITIONS, SAMPLES) if t.name in topics}
        self._subscriptions: dict[str, Subscription] = {}
        qos = STREAM_IN if reliability == RELIABLE else LOSSY_IN
        for name, kind in topics.items():
            subscription = node.create_subscription(kind, name, _unused, qos, raw=True)
            # Not given to `create_subscription`: the warnings of incompatible publishers stay with the executor.
            subscription.callback_group = _NotForExecutors()
            self._subscriptions[name] = subscription

    def close(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def read(self) -> None:
        """Pass on the messages that have arrived since the last call."""
        if not self._ready():
            return
        batches = {topic: self._take(subscription) for topic, subscription in self._subscriptions.items()}
        if any(batches.values()):
            self.pass_on(batches)

    def pass_on(self, batches: Mapping[str, Sequence[Taken]]) -> None:
        """Pass on messages by topic as if they had just arrived."""
        read, admitted, newest_ns = [], set(), 0
        for topic, batch in batches.items():
            if batch:
                infos = [info for _, info in batch]
                messages = self._readers[topic].read([data for data, _ in batch])
                read.append(zip(messages, repeat(topic), infos, strict=False))
                newest_ns = max(newest_ns, messages[-1].stamp_ns)
                if self._sources.usual(topic, messages, infos):
                    admitted.add(topic)
        for message, topic, info in heapq.merge(*read, key=_stamp):
            if topic in admitted or self._sources.admit(topic, message, info):
                self._callback(topic, message)
        self._end_of_batch()
        fast = newest_ns - self._newest_ns > FAST * self._pace_s * NANO
        self.read_s, self._newest_ns = READ_S if fast else self._pace_s, newest_ns

    def _take(self, subscription: Subscription) -> list[Taken]:
        """Return the messages that have arrived on a topic."""
        messages: list[Taken] = []
        with subscription.handle:
            while len(messages) < BATCH:
                taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                messages.append(taken)
        return messages


class _NotForExecutors(CallbackGroup):
    """Keeps an entity out of the wait sets of executors."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


def _unused(message: bytes) -> None:
    """Callback of a subscription that no executor serves."""


def _stamp(item: tuple[RawMessage, str, Mapping[str, Any]]) -> int:
    return item[0].stamp_ns
