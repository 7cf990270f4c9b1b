"""The instants of a stream's samples, from connection to connection."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from joint_id_core.rtde.client import Sample
from joint_id_core.rtde.clock import ControllerClock

WAITS = "stamp waits for the clock"  # why a sample without a stamp is held back


class Stamper:
    """Stamps samples in their order on the system's clock, whose steps are those of the controller's clock.

    Where `ControllerClock` finds its stamps to be ahead of the arrivals, it lets them wait, a nanosecond apart, until
    the arrivals have caught up. A velocity or a filter made of such steps is nonsense: those samples get no stamp.
    """

    def __init__(self, on_event: Callable[[str, str], None]) -> None:
        """`on_event` gets kind and text where one of the two clocks was set."""
        self._clock = ControllerClock(on_event)
        self._anew = True
        self._timestamp_s, self._stamp_ns = math.nan, 0

    def new_connection(self) -> None:
        """The robot may have been started anew, and its clock with it."""
        self._clock.forget()
        self._anew = True

    def stamp(self, sample: Sample, newest: Sample) -> int | None:
        """System time in ns at which a sample was taken; None while that cannot be told.

        `newest` is the last of the samples that arrived with it.
        """
        timestamp_s: Any = sample.values["timestamp"]
        received_ns = sample.received_ns
        if self._anew:
            # The first ones may have waited for this thread while it was starved, the newest the least of them.
            last: Any = newest.values["timestamp"]
            received_ns = newest.received_ns - round(max(0.0, last - timestamp_s) * 1e9)
            self._anew = False
        stamp_ns = self._clock.stamp(timestamp_s, received_ns)
        step_s, step_ns = timestamp_s - self._timestamp_s, stamp_ns - self._stamp_ns
        self._timestamp_s, self._stamp_ns = timestamp_s, stamp_ns
        waits = 0 <= step_ns < 0.5e9 * step_s
        return None if waits else stamp_ns
