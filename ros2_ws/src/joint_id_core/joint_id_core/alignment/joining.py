"""Join messages of several topics by equal stamps."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import Generic, TypeVar

from joint_id_core.data.instants import NANO
from joint_id_core.errors import JointIdError

BACK_NS = NANO  # a stamp that goes back by more than this starts a new run (a bag played again)
AHEAD_NS = 86_400 * NANO  # so does one further ahead: times count from the begin of a run, and long ones lose digits

# A topic that has come is awaited so many times longer than one that has not: Fast DDS sends a lost message again, and
# those that came after it, when its writer's heartbeat is due, which is every 3 s.
COMES_AGAIN = 4.0

Part = TypeVar("Part")


def is_new_run(last_ns: int, stamp_ns: int) -> bool:
    """Return whether a stamp is so far from the previous one that a new run begins."""
    return last_ns - stamp_ns > BACK_NS or stamp_ns - last_ns > AHEAD_NS


class StampOrder:
    """Checks the order of stamps."""

    def __init__(self) -> None:
        self.last_ns: int | None = None

    def restarts(self, topic: str, stamp_ns: int) -> bool:
        """Check and store a stamp; return True if it jumps so far that a new run begins.

        Raises:
            JointIdError: the stamp is missing, repeats or is out of order; it is not stored.
        """
        last = self.last_ns
        restart = last is not None and is_new_run(last, stamp_ns)
        if stamp_ns == 0 and last is not None:  # a first stamp of zero may be a recording that begins at zero
            raise JointIdError(f"{topic}: the stamp is zero: stamp the messages when publishing")
        if last is not None and stamp_ns <= last and not restart:
            what = "repeats" if stamp_ns == last else f"goes back by {(last - stamp_ns) / NANO:.6g} s"
            raise JointIdError(f"{topic}: the stamp {what}: sample left out, mend the publisher's stamps")
        self.last_ns = stamp_ns
        return restart


class Joiner(Generic[Part]):
    """Joins messages with equal stamps, in order of their stamps.

    A stamp is complete when every active topic has delivered it or a later one. A topic becomes inactive when two
    conditions hold: the newest stamp of all topics is its patience after its last stamp (at the start: after the first
    stamp of all), and no message has come from it for that long in real time. The second condition is needed because a
    bag that is played fast may deliver topics unevenly. The patience is `wait_s` for a topic that has not come in this
    run, and `COMES_AGAIN` times as long for one that has. An inactive topic counts as not measured until its next
    message. So a topic that nobody publishes causes a delay of `wait_s` only once.

    Attributes:
        waiting: whether messages wait for those of other topics.
    """

    def __init__(self, topics: Collection[str], wait_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Build a joiner; `clock` returns the real time in s."""
        self._topics, self._wait_s, self._clock = tuple(topics), wait_s, clock
        self._start()

    def _start(self) -> None:
        self._orders = {topic: StampOrder() for topic in self._topics}
        self._heard = dict.fromkeys(self._topics, self._clock())
        self._pending: dict[int, dict[str, Part]] = {}
        self._newest: int | None = None
        self._first: int | None = None
        self._released: int | None = None

    @property
    def waiting(self) -> bool:
        return bool(self._pending)

    def add(self, topic: str, stamp_ns: int, part: Part) -> list[tuple[int, dict[str, Part]]]:
        """Add one message; return the stamps that became complete, each with its parts by topic.

        Raises:
            JointIdError: the stamp is missing, out of order, or too late to be joined; the message is left out.
        """
        done: list[tuple[int, dict[str, Part]]] = []
        first = self._orders[topic].last_ns is None
        restarts = self._orders[topic].restarts(topic, stamp_ns)
        # One stray message of another topic, far ahead, must not cost all messages of this one.
        if restarts or (first and self._released is not None and self._released - stamp_ns > BACK_NS):
            done = sorted(self._pending.items())  # messages of the previous run that still waited
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
        """Return the stamps that are complete now, each with its parts by topic.

        Call it regularly with `idle` while no message comes on any topic: then only real time counts.
        """
        if self._newest is None or self._first is None:
            return []
        until, now = self._newest, self._clock()
        for topic, order in self._orders.items():
            last = self._first - 1 if order.last_ns is None else order.last_ns
            patience_s = self._wait_s if order.last_ns is None else COMES_AGAIN * self._wait_s
            recent = not idle and self._newest - last < patience_s * NANO
            if recent or now - self._heard[topic] < patience_s:
                until = min(until, last)
        if until < (self._first if self._released is None else self._released):
            return []
        done = [(stamp, self._pending.pop(stamp)) for stamp in sorted(self._pending) if stamp <= until]
        if done:
            self._released = done[-1][0]
        return done
