"""How long nothing has come."""

from __future__ import annotations

from collections.abc import Callable

STEP_S = 0.1  # a longer step between two looks counts as one of this length


class Silence:
    """Adds up the time in which nothing comes, look by look.

    A clock that stands adds nothing, as that of a player that pauses. One that is set, or a process that did not run,
    adds no more than `STEP_S`.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        """Begin now; `now_s` is the clock in s."""
        self._now_s, self._looked_s, self._silent_s = now_s, now_s(), 0.0

    def look(self, came: bool) -> float:
        """Return for how long in s nothing has come, given whether something `came` since the last look."""
        now_s = self._now_s()
        step_s, self._looked_s = now_s - self._looked_s, now_s
        self._silent_s = 0.0 if came else self._silent_s + min(max(step_s, 0.0), STEP_S)
        return self._silent_s
