"""Subscriptions to streams of samples that are read in batches.

rclpy's executor needs 0.3 ms for every wake-up and delivers one message per topic. At 500 Hz with three topics this
takes half a core. So the first message of a batch waits `COALESCE_S` for more, and one wake-up reads all messages that
have arrived.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from joint_id_ros.conversions import nanoseconds
from joint_id_ros.options.reading import RELIABLE
from joint_id_ros.qos import LOSSY_IN, STREAM_IN
from joint_id_ros.sources import Sources

COALESCE_S = 0.005  # small compared with the lag of the filter (0.14 s) and the hop of the identifier
BATCH = 500  # most messages per topic and batch, so that timers and services are served in between


class Streams:
    """Subscribes to topics and passes their messages to one callback.

    The messages of one topic come in the order in which they were published. Messages of different topics come in the
    order of their stamps, so that no topic is ahead only because it was read first.
    """

    def __init__(
        self,
        node: Node,
        topics: Mapping[str, Any],
        callback: Callable[[str, Any], None],
        sources: Sources,
        reliability: str,
    ) -> None:
        """Subscribe.

        Args:
            node: the node that subscribes.
            topics: message classes by topic name.
            callback: gets the topic's name and the message.
            sources: is told of every message, and says which ones are left out.
            reliability: as in `ReadingOptions`.
        """
        self._node, self._callback, self._sources = node, callback, sources
        qos = STREAM_IN if reliability == RELIABLE else LOSSY_IN
        self._subscriptions: dict[str, Subscription] = {
            name: node.create_subscription(kind, name, self._reader(name), qos) for name, kind in topics.items()
        }

    def close(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _reader(self, topic: str) -> Callable[[Any, Any], None]:
        def on_message(message: Any, info: Any) -> None:  # rclpy gives `info` only to a function of two arguments
            self._on_message(topic, message, info)

        return on_message

    def _on_message(self, topic: str, message: Any, info: Any) -> None:
        time.sleep(COALESCE_S)
        batches = [self._take(name, [(message, info)] if name == topic else []) for name in self._subscriptions]
        for stamp_ns, name, one, its_info in heapq.merge(*batches, key=itemgetter(0)):
            if self._sources.admit(name, stamp_ns, one, its_info):
                self._callback(name, one)

    def _take(self, topic: str, messages: list[tuple[Any, Any]]) -> list[tuple[int, str, Any, Any]]:
        """Return stamp in ns, topic, message and info of `messages` and of all that have arrived on the topic since."""
        subscription = self._subscriptions[topic]
        with subscription.handle:
            while len(messages) < BATCH:
                taken = subscription.handle.take_message(subscription.msg_type, False)
                if taken is None:
                    break
                messages.append(taken)
        return [(nanoseconds(m.header.stamp), topic, m, info) for m, info in messages]
