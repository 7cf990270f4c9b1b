"""When an estimate is due."""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.online.window import SlidingWindow

# Batches of live samples end some milliseconds before or after a hop; one that ends too early would leave that hop out.
EARLY, EARLY_S = 0.25, 0.005  # share of a hop, and time in s, by which it may end too early


class Hops:
    """Tells which batch of samples ends a hop, `hop_s` seconds after the one before.

    A batch that ends late does not delay the next hop. Of the hops that one batch holds, only the last one counts.
    """

    def __init__(self, hop_s: float) -> None:
        self._hop_s = hop_s
        self._next = -np.inf
        self._first = True

    def begin(self, end: float) -> None:
        """Take the instant in s at which the first hop ends."""
        self._next = end

    def ends(self, recent: SlidingWindow) -> bool:
        """Return whether the newest of the samples ends a hop; call it once a batch."""
        # Half a sample: a window of 1000 samples ends one period before its length.
        slack = 1.5 * recent.period
        if not self._first:
            slack = max(slack, min(EARLY * self._hop_s, EARLY_S))
        if recent.end < self._next - slack:
            return False
        self._first = False
        passed = math.floor((recent.end + slack - self._next) / self._hop_s)
        self._next += self._hop_s * (1 + max(0, passed))
        return True
