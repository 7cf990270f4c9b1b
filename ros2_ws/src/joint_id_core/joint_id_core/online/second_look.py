"""Fits of all samples since the start, while the memory is young.

A short window of ordinary motion can have several minima, and the memory that begins with one of them follows it: its
steps are local. Fits that search anew, with more samples each time, find the lowest one.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass

from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.online.checks import Background
from joint_id_core.online.symmetric import solve
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate

AFTER = (2, 4, 8)  # window lengths of motion after which all samples so far are fitted
# Mean square distance of a fit and the memory, in the standard deviations of either, from which the memory begins anew
# with the fit. Both have seen the same samples, so the distance is smaller unless their minima differ.
APART = 1.0


@dataclass(frozen=True)
class Look:
    """A fit of all samples up to some instant, and all samples in motion up to now."""

    fit: Estimate
    samples: Recording


class SecondLook:
    """Keeps all samples in motion since the start for as long as they are fitted again.

    Args:
        window_s: length of the first window in s.
        background: does the fits.
    """

    def __init__(self, window_s: float, background: Background) -> None:
        self._window_s, self._background = window_s, background
        self.begin()

    def begin(self, samples: Recording | None = None) -> None:
        """Begin with the first samples, or anew with these: those before may be of another joint."""
        self._samples = SlidingWindow(2.0 * AFTER[-1] * self._window_s)
        self._left = [count * self._window_s for count in AFTER]
        self._running: Future[Estimate] | None = None
        if samples is not None:
            self.append(samples)

    def append(self, samples: Recording) -> None:
        """Add samples in motion."""
        if self._left or self._running is not None:
            self._samples.append(samples)

    def end(self) -> None:
        """Fit no more: the joint has changed, or the samples since the start are not all that is known."""
        self._left, self._running, self._samples = [], None, SlidingWindow(self._window_s)

    def run(self, fit: Callable[[Recording], Estimate], tested_from: float) -> Look | None:
        """Start a fit if one is due; return the result of one that has ended, else None.

        It waits until the samples of the fit were tested: the joint may have changed at their end. The newest stretch
        that agreed with what is known began at `tested_from`, in s.
        """
        if self._running is None and self._left and self._samples.duration >= self._left[0]:
            del self._left[0]
            recording = self._samples.recording()
            self._running = self._background(lambda: fit(recording))
        if self._running is None or not self._running.done() or self._running.result().end > tested_from:
            return None
        look, self._running = Look(self._running.result(), self._samples.recording()), None
        if not self._left:
            self.end()
        return look


def apart(fit: Estimate, known: tuple[Array, Array], coordinates: Coordinates) -> bool:
    """Return whether a fit and mean (k,) and covariance (k, k) of the memory are in different minima."""
    alone = Belief.after(fit, coordinates)
    away = alone.mean - known[0]
    return min(float(away @ solve(known[1], away)), float(away @ alone.precision @ away)) > APART * len(away)
