"""Samples that wait for the identifiers, between the thread that receives them and the one that uses them."""

from __future__ import annotations

import threading
from collections import deque

from joint_id_core.data.instants import NANO
from joint_id_ros.raw_messages import RawMessage

LONGEST_STEP_NS = NANO  # a longer one between two samples is a pause or a clock that was set
QUEUE_S = 10.0  # of samples at most wait for a running fit ...
KEEP_S = 5.0  # ... and if they are more, the newest of them are kept


class SampleQueue:
    """A queue of samples with their ages, for several threads.

    The age of a sample, in ns, is the time that samples cover before it: a clock that is set adds nothing.

    Attributes:
        newest_ns: age of the newest sample.
    """

    def __init__(self) -> None:
        self.newest_ns = 0
        self._lock = threading.Lock()
        self._last_stamp_ns: int | None = None
        self._taken_ns = 0  # newest sample that is not in the queue any more
        self._pending: deque[tuple[int, RawMessage]] = deque()
        self._new_run = False  # whether the next sample begins one

    def __len__(self) -> int:
        return len(self._pending)

    def add(self, message: RawMessage) -> int:
        """Add a sample; return how many old ones were left out, as more than `QUEUE_S` waited."""
        with self._lock:
            step_ns = message.stamp_ns - (self._last_stamp_ns or message.stamp_ns)
            self._last_stamp_ns = message.stamp_ns
            self.newest_ns += min(max(step_ns, 0), LONGEST_STEP_NS)
            self._pending.append((self.newest_ns, message))
            many = self.newest_ns - self._pending[0][0] > QUEUE_S * NANO
            return self._shorten(self.newest_ns - int(KEEP_S * NANO)) if many else 0

    def _shorten(self, first_ns: int) -> int:
        """Leave out the waiting samples before an age; return their number."""
        count = 0
        while self._pending[0][0] < first_ns:
            self._pending.popleft()
            count += 1
        return count

    def covers(self, span_ns: int) -> bool:
        """Return whether the samples since the last `take` cover a time, or a new run begins."""
        with self._lock:
            return self._new_run or self.newest_ns - self._taken_ns >= span_ns

    def take(self) -> tuple[list[tuple[int, RawMessage]], bool]:
        """Empty the queue; return ages and samples, and whether a new run begins with them."""
        with self._lock:
            self._taken_ns = self.newest_ns
            taken, new_run = list(self._pending), self._new_run
            self._pending.clear()
            self._new_run = False
            return taken, new_run

    def restart(self) -> None:
        """Forget the samples that wait: a new run begins with the next one."""
        with self._lock:
            self._pending.clear()
            self._new_run = True
