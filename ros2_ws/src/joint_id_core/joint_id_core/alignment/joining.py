"""Messages of several topics joined by equal stamps."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import Generic, TypeVar

from joint_id_core.data.instants import NANO
from joint_id_core.errors import JointIdError

BACK_NS = NANO  # a stamp that jumps back by more than this is a new run (a bag played again), not a slip
AHEAD_NS = 86_400 * NANO  # and so is one further ahead: times count from the begin of a run, and lose digits with it

Part = TypeVar("Part")


def is_new_run(last_ns: int, stamp_ns: int) -> bool:
    """Whether a stamp is too far from the one before to go on with it."""
    return last_ns - stamp_ns > BACK_NS or stamp_ns - last_ns > AHEAD_NS


class StampOrder:
    """Tells whether stamps come in order."""

    def __init__(self) -> None:
        self.last_ns: int | None = None

    def restarts(self, topic: str, stamp_ns: int) -> bool:
        """Note a stamp; True when it jumps so far that a new run begins.

        Raises:
            JointIdError: the stamp is missing, repeats or is out of order; it is not noted.
        """
        last = self.last_ns
        restart = last is not None and is_new_run(last, stamp_ns)
        if stamp_ns == 0 and last is not None:  # as the first of all it may be a recording that begins at zero
            raise JointIdError(f"{topic}: the stamp is zero: stamp the messages when publishing")
        if last is not None and stamp_ns <= last and not restart:
            what = "repeats" if stamp_ns == last else f"goes back by {(last - stamp_ns) / NANO:.6g} s"
            raise JointIdError(f"{topic}: the stamp {what}: sample left out, mend the publisher's stamps")
        self.last_ns = stamp_ns
        return restart


class Joiner(Generic[Part]):
    """Joins messages with equal stamps, in order of their stamps.

    A stamp is complete when every topic that is awaited has delivered it or a later one. A topic is no longer
    awaited when the newest stamp of all topics is `wait_s` beyond the last one that it delivered (at the start:
    beyond the first of all), and nothing has come from it for `wait_s` of real time either, as a bag that is
    played fast may bring topics unevenly. It then counts as not measured until it speaks again. So a topic that
    nobody publishes costs a delay of `wait_s` once, and not after that.
    """

    def __init__(self, topics: Collection[str], wait_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """`clock` gives the real time in s."""
        self._topics, self._wait_s, self._clock = tuple(topics), wait_s, clock
        self._start()

    def _start(self) -> None:
        self._orders = {topic: StampOrder() for topic in self._topics}
        self._heard = dict.fromkeys(self._topics, self._clock())
        self._pending: dict[int, dict[str, Part]] = {}
        self._newest: int | None = None
        self._first: int | None = None
        self._released: int | None = None

    def add(self, topic: str, stamp_ns: int, part: Part) -> list[tuple[int, dict[str, Part]]]:
        """Take one message and return the stamps that became complete, each with its parts by topic.

        Raises:
            JointIdError: the stamp is missing, out of order, or too late to be joined; the message is left out.
        """
        done: list[tuple[int, dict[str, Part]]] = []
        if self._orders[topic].restarts(topic, stamp_ns):
            done = sorted(self._pending.items())  # what still waited of the run before
            self._start()
            self._orders[topic].restarts(topic, stamp_ns)
        if not self._pending and self._newest is None:
            self._heard = dict.fromkeys(self._topics, self._clock())
        self._heard[topic] = self._clock()
        if self._released is not None and stamp_ns <= self._released:
            late = (self._newest or stamp_ns) - stamp_ns
            raise JointIdError(f"{topic}: a sample came {late / NANO:.3g} s after the others: left out")
        self._pending.setdefault(stamp_ns, {})[topic] = part
        self._first = stamp_ns if self._first is None else self._first
        self._newest = stamp_ns if self._newest is None else max(self._newest, stamp_ns)
        return done + self.release()

    def release(self, idle: bool = False) -> list[tuple[int, dict[str, Part]]]:
        """Stamps that are complete by now.

        To be called now and then with `idle` when no message comes on any topic: then only real time counts.
        """
        if self._newest is None or self._first is None:
            return []
        until, now = self._newest, self._clock()
        for topic, order in self._orders.items():
            last = self._first - 1 if order.last_ns is None else order.last_ns
            recent = not idle and self._newest - last < self._wait_s * NANO
            if recent or now - self._heard[topic] < self._wait_s:
                until = min(until, last)
        if until < (self._first if self._released is None else self._released):
            return []
        done = [(stamp, self._pending.pop(stamp)) for stamp in sorted(self._pending) if stamp <= until]
        if done:
            self._released = done[-1][0]
        return done
