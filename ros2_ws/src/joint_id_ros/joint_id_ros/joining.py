"""Messages of several topics joined by equal stamps."""

from __future__ import annotations

from collections.abc import Collection
from typing import Generic, TypeVar

from joint_id_core.errors import JointIdError

NANO = 10**9
RESTART_NS = NANO  # a stamp that jumps back by more than this is a new run (a bag played again), not a slip

Part = TypeVar("Part")


class StampOrder:
    """Tells whether stamps come in order."""

    def __init__(self) -> None:
        self.last_ns: int | None = None

    def restarts(self, topic: str, stamp_ns: int) -> bool:
        """Note a stamp; True when it jumps back to begin a new run.

        Raises:
            JointIdError: the stamp is missing, repeats or is out of order; it is not noted.
        """
        last, restart = self.last_ns, False
        if stamp_ns == 0 and last is not None:  # as the first of all it may be a recording that begins at zero
            raise JointIdError(f"{topic}: the stamp is zero: stamp the messages when publishing")
        if last is not None and stamp_ns <= last:
            restart = last - stamp_ns > RESTART_NS
            if not restart:
                what = "repeats" if stamp_ns == last else f"goes back by {(last - stamp_ns) / NANO:.6g} s"
                raise JointIdError(f"{topic}: the stamp {what}: sample left out, mend the publisher's stamps")
        self.last_ns = stamp_ns
        return restart


class Joiner(Generic[Part]):
    """Joins messages with equal stamps, in order of their stamps.

    A stamp is complete when every topic that is awaited has delivered it or a later one. A topic is awaited
    until the newest stamp of all topics is `wait_s` beyond the last one it delivered (at the start: beyond
    the first one of all); from then on it counts as not measured until it speaks again. So a topic that
    nobody publishes costs a delay of `wait_s` once, and not after that. Time is counted in stamps alone: what
    comes out does not depend on how fast messages arrive.
    """

    def __init__(self, topics: Collection[str], wait_s: float) -> None:
        self._topics, self._wait_ns = tuple(topics), round(wait_s * NANO)
        self._start()

    def _start(self) -> None:
        self._orders = {topic: StampOrder() for topic in self._topics}
        self._pending: dict[int, dict[str, Part]] = {}
        self._newest: int | None = None
        self._first: int | None = None
        self._released: int | None = None

    def add(self, topic: str, stamp_ns: int, part: Part) -> list[tuple[int, dict[str, Part]]]:
        """Take one message and return the stamps that became complete, each with its parts by topic.

        Raises:
            JointIdError: the stamp is missing, out of order, or too late to be joined; the message is left out.
        """
        if self._orders[topic].restarts(topic, stamp_ns):
            self._start()
            self._orders[topic].restarts(topic, stamp_ns)
        if self._released is not None and stamp_ns <= self._released:
            late = (self._newest or stamp_ns) - stamp_ns
            raise JointIdError(f"{topic}: a sample came {late / NANO:.3g} s after the others: left out")
        self._pending.setdefault(stamp_ns, {})[topic] = part
        self._first = stamp_ns if self._first is None else self._first
        self._newest = stamp_ns if self._newest is None else max(self._newest, stamp_ns)
        return self._release()

    def _release(self) -> list[tuple[int, dict[str, Part]]]:
        assert self._newest is not None and self._first is not None
        until = self._newest
        for order in self._orders.values():
            last = self._first - 1 if order.last_ns is None else order.last_ns
            if self._newest - last < self._wait_ns:
                until = min(until, last)
        done = [(stamp, self._pending.pop(stamp)) for stamp in sorted(self._pending) if stamp <= until]
        if done:
            self._released = done[-1][0]
        return done
