"""Count missing samples from the time stamps of the samples that arrived."""

from __future__ import annotations

import math

_LEAK = 200e-6  # s/s; largest drift between two clocks
_AHEAD_S = 0.1  # a sample that arrives earlier than its stamp allows by this shows a clock that was set, not a loss


class LossCounter:
    """Distinguishes lost samples from jumps of the controller's clock; use one for each connection.

    A sample cannot arrive before it was taken. So the smallest recent difference between arrival and stamp limits how
    late a stamp can be. A stamp beyond this limit shows a jump of the clock.

    Args:
        rate: rate in Hz at which the controller sends.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._last: float | None = None
        self._soonest = 0.0  # smallest arrival minus stamp, s
        self._unusable = 0  # number of samples without a time since the last sample with a time

    def count(self, timestamp: float, arrived_s: float) -> int | None:
        """Return the number of samples missing before this one; None if the controller's clock has jumped.

        Args:
            timestamp: controller time in s; not finite or zero for a sample that arrived without a valid time.
            arrived_s: arrival time in s on a clock that is never set.
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
