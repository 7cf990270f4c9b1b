"""Puts the controller's time on the system's clock, without the jitter of the network."""

from __future__ import annotations

import time
from collections.abc import Callable

_SLEW = 200e-6  # s/s: what a crystal, and a system clock that is being corrected, may drift
_AHEAD_NS = 100_000_000  # a sample that arrives so much too soon: the controller's clock was set
_LATE_NS, _LATE_FOR_NS = 100_000_000, 10_000_000_000  # all samples so late for so long: the clock, not the network
_SET_NS = 1_000_000  # least step of the system clock that counts as its being set


def _system_ahead_ns() -> int:
    """System clock minus the clock that nobody sets, ns. Both follow the same crystal and its corrections."""
    return time.time_ns() - time.monotonic_ns()


class ControllerClock:
    """System time of the samples of one controller.

    A sample arrives later than it was taken, never sooner. The offset of the two clocks is therefore the smallest
    difference of arrival and controller time seen lately: the smallest so far, let rise by 200 ppm, faster than which
    no two good clocks drift apart. Stamps follow it by at most 200 ppm too: the steps between them are those of the
    controller, and a second without a prompt packet moves them by 0.2 ms.

    Stamps are late by the smallest delay of the network and some 10 us where delays scatter by a fraction of a
    millisecond. The first sample is believed: where it came late, so are the stamps, until 200 ppm have made it good.

    Args:
        on_event: called with "clock set" and a text when one of the two clocks was set.
        system_ahead_ns: system clock minus a clock that nobody sets, ns.
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
        self._controller_ns = 0  # of the newest sample
        self._steady_ns = -(1 << 62)  # the same instant on the clock that nobody sets
        # The offset, steady minus controller time: an anchor, and small differences from it, for which floats do.
        self._anchor_ns = 0
        self._lowest = self._slewed = 0.0
        self._late_since_ns: int | None = None  # controller time
        self._least_late = 0.0

    def forget(self) -> None:
        """Take the offset anew from the next sample. For a new connection: the robot may have been restarted."""
        self._anchored = False

    def stamp(self, timestamp_s: float, received_ns: int) -> int:
        """System time in ns at which a sample was taken; increases strictly, except where the system clock is set back.

        Args:
            timestamp_s: its time on the controller's clock, s.
            received_ns: system time at which it arrived, ns.
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
        """Let the offset follow what this arrival says of it."""
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
        """Take the offset from this sample alone."""
        # Stamps that were ahead of the arrivals wait for these rather than go back.
        self._anchor_ns = max(arrived_ns, self._steady_ns + 1) - controller_ns
        self._lowest = self._slewed = 0.0
        self._late_since_ns = None
        self._anchored = True

    def _shift(self, controller_ns: int, arrived_ns: int, why: str) -> None:
        """Take the offset anew, and tell."""
        before = self._anchor_ns + self._slewed
        self._anchor(controller_ns, arrived_ns)
        change_s = (self._anchor_ns - before) * 1e-9
        self._on_event("clock set", f"{why}: its offset to the system's clock changes by {change_s:+.3f} s")

    def _watch_system_clock(self, received_ns: int) -> None:
        """Notice that the system clock was set."""
        ahead_ns = self._system_ahead_ns()
        if abs(ahead_ns - self._ahead_ns) < _SET_NS:
            return
        # The thread may have been held up between the readings of the two clocks: once, but hardly thrice.
        ahead_ns = sorted((ahead_ns, self._system_ahead_ns(), self._system_ahead_ns()))[1]
        change_ns = ahead_ns - self._ahead_ns
        if abs(change_ns) < _SET_NS:
            return
        self._ahead_ns, self._unsure_ns = ahead_ns, received_ns
        self._on_event("clock set", f"the system's clock was set by {change_ns * 1e-9:+.3f} s, and stamps with it")
