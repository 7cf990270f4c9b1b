"""Convert controller time to system time without the jitter of the network."""

from __future__ import annotations

import time
from collections.abc import Callable

_SLEW = 200e-6  # s/s: largest drift of a crystal and of a system clock that is being corrected
_AHEAD_NS = 100_000_000  # if a sample arrives earlier than expected by this, the controller's clock was set
_LATE_NS, _LATE_FOR_NS = 100_000_000, 10_000_000_000  # all samples late by this, for this long: it is the clock
_SET_NS = 1_000_000  # smallest step of the system clock that counts as setting it


def _system_ahead_ns() -> int:
    """Return system clock minus monotonic clock in ns. Both follow the same crystal and its corrections."""
    return time.time_ns() - time.monotonic_ns()


class ControllerClock:
    """Computes the system time of the samples of one controller.

    A sample never arrives before it was taken. So the offset of the two clocks is estimated as the smallest recent
    difference between arrival time and controller time. This minimum may rise by 200 ppm, the largest drift between two
    good clocks. Stamps also follow it by at most 200 ppm. So the steps between stamps are those of the controller, and
    a second in which all packets are late moves the stamps by at most 0.2 ms.

    Stamps are late by the smallest delay of the network, plus some 10 us if delays scatter by a fraction of a
    millisecond. The first sample sets the offset. If it arrived late, stamps are late, too, until the offset has been
    corrected at 200 ppm.

    Args:
        on_event: called with "clock set" and a text when one of the two clocks was set.
        system_ahead_ns: returns system clock minus a clock that is never set, in ns.
    """

    def __init__(
        self,
        on_event: Callable[[str, str], None] = lambda kind, text: None,
        system_ahead_ns: Callable[[], int] = _system_ahead_ns,
    ) -> None:
        self._on_event, self._system_ahead_ns = on_event, system_ahead_ns
        self._ahead_ns = system_ahead_ns()
        self._unsure_ns = -1  # an arrival that may be from before the system clock was set
        self._anchored = False
        self._controller_ns = 0  # controller time of the newest sample
        self._steady_ns = -(1 << 62)  # the same instant on the clock that is never set
        # Offset, steady minus controller time: an integer anchor, and small differences from it as floats.
        self._anchor_ns = 0
        self._lowest = self._slewed = 0.0
        self._late_since_ns: int | None = None  # controller time
        self._least_late = 0.0

    def forget(self) -> None:
        """Set the offset again from the next sample. Use it for a new connection: the robot may have been restarted."""
        self._anchored = False

    def stamp(self, timestamp_s: float, received_ns: int) -> int:
        """Return the system time in ns at which a sample was taken.

        It increases strictly unless the system clock is set back.

        Args:
            timestamp_s: time of the sample on the controller's clock in s.
            received_ns: system time in ns at which the sample arrived.
        """
        self._watch_system_clock(received_ns)
        controller_ns = round(timestamp_s * 1e9)
        arrived_ns = received_ns - self._ahead_ns
        if not self._anchored:
            self._anchor(controller_ns, arrived_ns)
        elif controller_ns < self._controller_ns:
            self._shift(controller_ns, arrived_ns, "the controller's clock went back")
        elif received_ns != self._unsure_ns:
            self._follow(controller_ns, arrived_ns)
        self._controller_ns = controller_ns
        steady_ns = controller_ns + self._anchor_ns + round(self._slewed)
        self._steady_ns = max(steady_ns, self._steady_ns + 1)
        return self._steady_ns + self._ahead_ns

    def _follow(self, controller_ns: int, arrived_ns: int) -> None:
        """Update the offset from this arrival."""
        offset = float(arrived_ns - controller_ns - self._anchor_ns)
        slew = _SLEW * (controller_ns - self._controller_ns)
        if offset < self._slewed - slew - _AHEAD_NS:
            self._shift(controller_ns, arrived_ns, "the controller's clock ran ahead of the arrival of its samples")
            return
        self._lowest = min(self._lowest + slew, offset)
        self._slewed += min(max(self._lowest - self._slewed, -slew), slew)
        if offset < self._slewed + _LATE_NS:
            self._late_since_ns = None
        elif self._late_since_ns is None:
            self._late_since_ns, self._least_late = controller_ns, offset
        else:
            self._least_late = min(self._least_late, offset)
            if controller_ns - self._late_since_ns > _LATE_FOR_NS:
                arrived_ns = controller_ns + self._anchor_ns + round(self._least_late)
                why = "the controller's clock stood still, or this computer cannot keep up"
                self._shift(controller_ns, arrived_ns, why)

    def _anchor(self, controller_ns: int, arrived_ns: int) -> None:
        """Set the offset from this sample alone."""
        # Stamps must not go back: if they were ahead of the arrivals, they wait.
        self._anchor_ns = max(arrived_ns, self._steady_ns + 1) - controller_ns
        self._lowest = self._slewed = 0.0
        self._late_since_ns = None
        self._anchored = True

    def _shift(self, controller_ns: int, arrived_ns: int, why: str) -> None:
        """Set the offset again from this sample, and report it."""
        before = self._anchor_ns + self._slewed
        self._anchor(controller_ns, arrived_ns)
        change_s = (self._anchor_ns - before) * 1e-9
        self._on_event("clock set", f"{why}: its offset to the system's clock changes by {change_s:+.3f} s")

    def _watch_system_clock(self, received_ns: int) -> None:
        """Detect that the system clock was set."""
        ahead_ns = self._system_ahead_ns()
        if abs(ahead_ns - self._ahead_ns) < _SET_NS:
            return
        # The thread may have been delayed between the two clock readings. The median of three readings avoids that.
        ahead_ns = sorted((ahead_ns, self._system_ahead_ns(), self._system_ahead_ns()))[1]
        change_ns = ahead_ns - self._ahead_ns
        if abs(change_ns) < _SET_NS:
            return
        self._ahead_ns, self._unsure_ns = ahead_ns, received_ns
        self._on_event("clock set", f"the system's clock was set by {change_ns * 1e-9:+.3f} s, and stamps with it")
