"""Stamp the samples of a stream, over several connections."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from joint_id_core.rtde.client import Sample
from joint_id_core.rtde.clock import ControllerClock

WAITS = "stamp waits for the clock"  # reason why a sample without a stamp is not used


class Stamper:
    """Stamps samples, in their order, with the system time; the steps are those of the controller's clock.

    If the stamps of `ControllerClock` are ahead of the arrivals, they wait, 1 ns apart, until the arrivals have caught
    up. Such steps would make velocities and filters wrong, so these samples get no stamp.
    """

    def __init__(self, on_event: Callable[[str, str], None]) -> None:
        """Build a stamper; `on_event` is called with kind and text when one of the two clocks was set."""
        self._clock = ControllerClock(on_event)
        self._anew = True
        self._timestamp_s, self._stamp_ns = math.nan, 0

    def new_connection(self) -> None:
        """Tell that a new connection begins: the robot, and with it its clock, may have been restarted."""
        self._clock.forget()
        self._anew = True

    def stamp(self, sample: Sample, newest: Sample) -> int | None:
        """Return the system time in ns at which a sample was taken; None while it is not known.

        `newest` is the last of the samples that arrived together with this one.
        """
        timestamp_s: Any = sample.values["timestamp"]
        received_ns = sample.received_ns
        if self._anew:
            # The first samples may have waited because this thread did not run; the newest one waited least.
            last: Any = newest.values["timestamp"]
            received_ns = newest.received_ns - round(max(0.0, last - timestamp_s) * 1e9)
            self._anew = False
        stamp_ns = self._clock.stamp(timestamp_s, received_ns)
        step_s, step_ns = timestamp_s - self._timestamp_s, stamp_ns - self._stamp_ns
        self._timestamp_s, self._stamp_ns = timestamp_s, stamp_ns
        waits = 0 <= step_ns < 0.5e9 * step_s
        return None if waits else stamp_ns
