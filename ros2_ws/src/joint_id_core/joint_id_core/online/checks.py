"""Fits of whole windows beside the recursion, for tests of the residuals, and for noise levels that are in doubt."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate

CHECK_AFTER, CHECK_EVERY = (1, 2, 4), 8  # window lengths after which the newest window is fitted as a whole

T = TypeVar("T")


class Background(Protocol):
    """Starts a job that does not delay the caller."""

    def __call__(self, job: Callable[[], T], /) -> Future[T]:
        """Start a job; return its result when it has ended."""


def at_once(job: Callable[[], T]) -> Future[T]:
    """Do a job within the call."""
    done: Future[T] = Future()
    done.set_result(job())
    return done


@dataclass(frozen=True)
class Checked:
    """Fit of a window by itself, and whether the noise levels were in doubt when the window was taken."""

    fit: Estimate
    doubted: bool


@dataclass(frozen=True)
class _Running:
    """A fit that was begun, the end of its window in s, and whether it answers a doubt."""

    fit: Future[Estimate]
    end: float
    doubted: bool


class WindowChecks:
    """Fits the newest window by itself, from time to time or when the noise levels are in doubt.

    A doubt is answered by a window that was taken after it arose, not by one whose fit runs already.

    The result of a fit waits until samples that follow its window were tested. A joint that changed near the end of the
    window leaves residuals that look like a wrong model; the test finds the change, and the result is dropped.

    Args:
        window_s: length of the window in s.
        background: does the fits.
    """

    def __init__(self, window_s: float, background: Background) -> None:
        self._window_s, self._background = window_s, background
        self._count, self._next = 0, np.inf
        self._running: _Running | None = None
        self._doubt, self._changed_at = False, -np.inf

    def begin(self, end: float, changed_at: float = -np.inf) -> None:
        """Begin anew with a window that was fitted, its end in s; no window with a change in it, at an instant in s."""
        self._changed_at = changed_at
        self._count, self._next, self._running, self._doubt = 0, end + CHECK_AFTER[0] * self._window_s, None, False

    def ask(self) -> None:
        """Let the next check come now: the newest innovations are not those that the noise levels allow."""
        if not self._doubt:
            self._next, self._doubt = -np.inf, True

    def due(self, window: SlidingWindow) -> bool:
        """Return whether `run` starts a check."""
        return self._running is None and window.end >= self._next and window.start >= self._changed_at

    def run(self, window: SlidingWindow, fit: Callable[[Recording], Estimate], tested_from: float) -> Checked | None:
        """Start a check if one is due; return the result of one that has ended, else None.

        The newest stretch of samples that agreed with what is known began at `tested_from`, in s.
        """
        if self.due(window):
            self._count += 1
            length = CHECK_AFTER[self._count] if self._count < len(CHECK_AFTER) else CHECK_EVERY
            self._next = window.end + length * self._window_s
            recording = window.recording()
            self._running = _Running(self._background(lambda: fit(recording)), window.end, self._doubt)
        running = self._running
        if running is None or tested_from < running.end or not running.fit.done():
            return None
        self._running, self._doubt = None, self._doubt and not running.doubted
        return Checked(running.fit.result(), running.doubted)
