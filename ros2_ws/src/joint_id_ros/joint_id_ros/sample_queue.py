"""Samples that wait for the identifiers, between the thread that receives them and the one that uses them."""

from __future__ import annotations

import threading
from collections import deque

from joint_id_core.data.instants import NANO
from joint_id_ros.raw_messages import RawMessage

LONGEST_STEP_NS = NANO  # a longer one between two samples is a pause or a clock that was set
QUEUE_S = 10.0  # of samples at most wait for a running fit ...
KEEP_S = 5.0  # ... and if they are more, the newest of them are kept
RECORDED_S = 2.0  # of recorded samples wait, and the others stay where they come from
LOST_HERE = "lost by this computer"  # kind of the problem that samples are left out


def left_out(count: int) -> str:
    """Return the words for samples that waited too long."""
    return (
        f"{count} samples left out: they waited for fits, which are slower than the samples come. Identify fewer "
        "joints, or take a longer hop_s"
    )


class SampleQueue:
    """A queue of samples with their ages, for several threads.

    The age of a sample, in ns, is the time that samples cover before it: a clock that is set adds nothing.

    Attributes:
        newest_ns: age of the newest sample.
    """

    def __init__(self, recorded_ns: int | None = None) -> None:
        """Build a queue.

        Args:
            recorded_ns: time of samples that `take` returns at most, of a recording whose samples all matter; None for
                live samples, of which the newest matter.
        """
        self.newest_ns, self._recorded_ns = 0, recorded_ns
        self._lock = threading.Lock()
        self._last_stamp_ns: int | None = None
        self._taken_ns = 0  # newest sample that is not in the queue any more
        self._pending: deque[tuple[int, RawMessage]] = deque()
        self._run_ends: deque[int] = deque()  # ages at which runs end, of which samples wait or the next one has begun

    def __len__(self) -> int:
        return len(self._pending)

    @property
    def full(self) -> bool:
        """Whether so many recorded samples wait that no more should be added for now."""
        with self._lock:
            return self._recorded_ns is not None and self._waiting_ns > RECORDED_S * NANO

    @property
    def _waiting_ns(self) -> int:
        return self.newest_ns - self._pending[0][0] if self._pending else 0

    def add(self, message: RawMessage) -> int:
        """Add a sample; return how many old ones were left out, as more than `QUEUE_S` waited and are not recorded."""
        with self._lock:
            step_ns = message.stamp_ns - (self._last_stamp_ns or message.stamp_ns)
            self._last_stamp_ns = message.stamp_ns
            self.newest_ns += min(max(step_ns, 0), LONGEST_STEP_NS)
            self._pending.append((self.newest_ns, message))
            many = self._recorded_ns is None and self._waiting_ns > QUEUE_S * NANO
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
            return bool(self._run_ends) or self.newest_ns - self._taken_ns >= span_ns

    def take(self) -> tuple[list[tuple[int, RawMessage]], bool]:
        """Return ages and samples, all that wait or `recorded_ns` of them, and whether a new run begins with them."""
        with self._lock:
            new_run, last_ns = False, self.newest_ns
            while self._run_ends and not (self._pending and self._pending[0][0] <= self._run_ends[0]):
                self._run_ends.popleft()
                new_run = True
            if self._recorded_ns is not None and self._pending:
                last_ns = min(self._pending[0][0] + self._recorded_ns, *self._run_ends, last_ns)
            taken = []
            while self._pending and self._pending[0][0] <= last_ns:
                taken.append(self._pending.popleft())
                self._taken_ns = taken[-1][0]
            return taken, new_run

    def restart(self) -> None:
        """Begin a new run with the next sample; samples that wait are forgotten, unless they are recorded."""
        with self._lock:
            if self._recorded_ns is None:
                self._pending.clear()
            self._run_ends.append(self.newest_ns)
            self.newest_ns += 1  # the stamp of the next sample may be earlier
