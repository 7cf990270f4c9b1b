"""The newest motion of a joint, for what is done with it from time to time."""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.online.window import SlidingWindow


class NewestMotion:
    """Keeps the newest samples in motion, and counts how much more of it is waited for.

    Args:
        length_s: of the motion that is kept, in s.
        waits_s: motion in s until it is `due` for the first time.
    """

    def __init__(self, length_s: float, waits_s: float) -> None:
        self._window, self._waits_s = SlidingWindow(length_s), waits_s

    def append(self, samples: Recording) -> None:
        """Add samples."""
        self._window.append(samples)
        self._waits_s -= samples.duration * (1.0 + 1.0 / max(1, len(samples) - 1))

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
        return self._window.duration

    @property
    def end(self) -> float:
        """Instant of the newest sample in s; -inf before the first."""
        return self._window.end

    def recording(self) -> Recording:
        """Return the samples."""
        return self._window.recording()
