"""What holds while a memory does not describe the newest samples, and until a new one has proved itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.online.follower import Found
from joint_id_core.online.knowledge import Knowledge
from joint_id_core.online.late_sensor import Late
from joint_id_core.results.estimate import Estimate

AGAIN_S = 1.0  # time between two fits of windows that the memory does not describe
# Fits of windows that the model does not describe take the longest. One that takes longer than this processor time in s
# is followed by as much motion without one; once they failed for so many window lengths, they may take this share of a
# processor.
LONG_S, PATIENCE, SHARE = 1.0, 2.0, 0.1
# Window lengths of motion that must agree with a new fit where no change of the joint explained the samples: then the
# model may not describe them, as with a sensor that is late, and a window can be fitted well by parameters far off.
TRIAL = 4.0


class Trial:
    """The trial of the next memory.

    Args:
        window_s: length of the window in s.

    Attributes:
        length_s: motion in s that must agree with a new memory before it counts.
        replaces: whether it would replace a memory.
        shown: newest fit, or estimate before, which says what is wrong; None if no memory is in doubt.
        blames_sensor: whether it says that a sensor is late.
    """

    def __init__(self, window_s: float) -> None:
        self.length_s, self.replaces = window_s, False
        self.shown: Estimate | None = None
        self.blames_sensor = False
        self._window_s = window_s
        self._trusted: Knowledge | None = None  # what was known, until something new counts
        self._fit_next, self._fails_since = -np.inf, np.inf

    def suspend(self, known: Knowledge) -> None:
        """Put aside a memory that does not describe the newest samples."""
        self.shown, self._fit_next = known.last, -np.inf
        unexplained = known.follower.found is Found.UNEXPLAINED
        if unexplained or not self.replaces:
            self.length_s = TRIAL * self._window_s if unexplained else 0.0
        if not self.replaces:
            self._trusted = known
        self.replaces = True

    def begin_anew(self, known: Knowledge) -> None:
        """Trust nothing that was known."""
        self.shown, self.replaces, self._trusted, self.blames_sensor = known.last, True, None, False

    def due(self, end: float) -> bool:
        """Return whether the newest window, which ends at an instant in s, is to be fitted; call it once a hop."""
        if self.waits(end):
            return False
        self._fit_next = end + AGAIN_S
        return True

    def waits(self, end: float) -> bool:
        """Return whether the newest window, which ends at an instant in s, is not to be fitted yet."""
        return end < self._fit_next

    def failed(self, fit: Estimate, end: float, took_s: float) -> None:
        """Take a fit that does not describe the newest window, which ends at `end` (s), and its processor time in s."""
        self.shown = fit
        self._fails_since = min(self._fails_since, end)
        if end > self._fails_since + PATIENCE * self._window_s:
            self._fit_next = max(self._fit_next, end + took_s / SHARE)
        elif took_s > LONG_S:
            self._fit_next = max(self._fit_next, end + took_s)

    def succeeded(self) -> None:
        """Take that a fit described the newest window."""
        self._fails_since = np.inf

    def late(self, recording: Recording) -> Late | None:
        """Return the sensor whose delay explains a window of a joint that is as it was; None if there is none."""
        found = None if self._trusted is None else self._trusted.late_sensor(recording)
        self.blames_sensor = found is not None
        if found is not None and self._trusted is not None:
            self.shown = replace(self._trusted.last, notes=(found.text, *self._trusted.last.notes))
        return found
