"""Subscriptions to streams of samples that are read in batches.

rclpy's executor needs 0.3 ms for every wake-up and delivers one message per topic. At 500 Hz with three topics this
takes half a core. So the first message of a batch waits `COALESCE_S` for more, and one wake-up reads all messages that
have arrived. They are taken as bytes, because rclpy needs 0.1 ms to make an object of a message.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from joint_id_core.formats.topics import RAW, SAMPLES
from joint_id_ros.qos import STREAM_IN
from joint_id_ros.raw_messages import RawMessage, Reader

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
        callback: Callable[[str, RawMessage], None],
        end_of_batch: Callable[[], None] = lambda: None,
    ) -> None:
        """Subscribe.

        Args:
            node: the node that subscribes.
            topics: message classes by topic name, of topics in `formats.topics`.
            callback: gets the topic's name and the message.
            end_of_batch: called after the last of the messages that were read together.
        """
        self._node, self._callback, self._end_of_batch = node, callback, end_of_batch
        self._readers = {t.name: Reader(t, topics[t.name]) for t in (*RAW, SAMPLES) if t.name in topics}
        self._subscriptions: dict[str, Subscription] = {
            name: node.create_subscription(kind, name, partial(self._on_message, name), STREAM_IN, raw=True)
            for name, kind in topics.items()
        }

    def close(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _on_message(self, topic: str, message: bytes) -> None:
        time.sleep(COALESCE_S)
        self.pass_on({name: self._take(name, [message] if name == topic else []) for name in self._subscriptions})

    def pass_on(self, batches: Mapping[str, list[bytes]]) -> None:
        """Pass on messages by topic as if they had just arrived."""
        read = [[(message, topic) for message in self._readers[topic].read(data)] for topic, data in batches.items()]
        for message, topic in heapq.merge(*read, key=_stamp):
            self._callback(topic, message)
        self._end_of_batch()

    def _take(self, topic: str, messages: list[bytes]) -> list[bytes]:
        """Return `messages` and all that have arrived on the topic since."""
        subscription = self._subscriptions[topic]
        with subscription.handle:
            while len(messages) < BATCH:
                taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                messages.append(taken[0])
        return messages


def _stamp(item: tuple[RawMessage, str]) -> int:
    return item[0].stamp_ns
