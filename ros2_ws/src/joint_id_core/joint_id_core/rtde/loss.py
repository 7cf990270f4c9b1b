"""Counts samples that are missing, by the time stamps of those that are there."""

from __future__ import annotations

import math

_LEAK = 200e-6  # s/s; no two clocks drift apart faster
_AHEAD_S = 0.1  # a stamp so much earlier than its arrival allows is a clock that was set, not lost samples


class LossCounter:
    """Tells gaps in the controller's time from jumps of its clock; one for each connection.

    A sample cannot arrive before it was taken. The smallest difference of arrival and stamp seen lately therefore
    bounds how late a sample can be stamped, and a step beyond that is a jump.

    Args:
        rate: samples a second that the controller sends.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._last: float | None = None
        self._soonest = 0.0  # smallest arrival minus stamp, s
        self._unusable = 0  # samples without a time since the last one with

    def count(self, timestamp: float, arrived_s: float) -> int | None:
        """Samples missing between this one and the one before; None where the controller's clock has jumped.

        Args:
            timestamp: controller time in s. Not finite or zero: the sample arrived, but says nothing of its time.
            arrived_s: time in s of a clock that nobody sets.
        """
        if not math.isfinite(timestamp) or timestamp == 0.0:
            self._unusable += 1
            return 0
        last, self._last = self._last, timestamp
        unusable, self._unusable = self._unusable, 0
        delay = arrived_s - timestamp
        if last is None:
            self._soonest = delay
            return 0
        step = timestamp - last
        if step < 0.0 or delay < self._soonest - _AHEAD_S:
            self._soonest = delay
            return None
        self._soonest = min(self._soonest + _LEAK * step, delay)
        return max(0, round(step * self._rate) - 1 - unusable)
