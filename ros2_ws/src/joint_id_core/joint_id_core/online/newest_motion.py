"""The newest motion of a joint, for what is done with it from time to time."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.online.window import REST, SlidingWindow, joined

GATHERED = 32  # parts that are put into the window together, as each one takes as long there


class NewestMotion:
    """Keeps the newest samples in motion, and counts how much more of it is waited for.

    Args:
        length_s: of the motion that is kept, in s.
        waits_s: motion in s until it is `due` for the first time.

    Attributes:
        end: instant of the newest sample in s; -inf before the first.
    """

    def __init__(self, length_s: float, waits_s: float) -> None:
        self._window, self._waits_s, self.end = SlidingWindow(length_s), waits_s, -np.inf
        self._new: list[Recording] = []  # later than the window, without a pause

    def append(self, samples: Recording) -> None:
        """Add later samples."""
        steps, begin, length = len(samples) - 1, float(samples.time[0]), samples.duration
        goes_on = steps > 0 and (begin - self.end) * steps < REST * length
        if not goes_on or len(self._new) == GATHERED:
            self._gather()
        self._new.append(samples)
        self._waits_s -= length * (1.0 + 1.0 / max(1, steps))
        self.end = begin + length

    def _gather(self) -> None:
        """Put the new samples into the window."""
        if self._new:
            self._window.append(joined(self._new))
            self._new = []

    def wait(self, seconds: float) -> None:
        """Wait for so much more motion, in s."""
        self._waits_s = seconds

    @property
    def due(self) -> bool:
        """Whether as much motion as was waited for has come."""
        return self._waits_s <= 0.0

    @property
    def duration(self) -> float:
        """Of the motion that is kept, in s."""
        self._gather()
        return self._window.duration

    def recording(self) -> Recording:
        """Return the samples."""
        self._gather()
        return self._window.recording()
