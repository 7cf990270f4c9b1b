"""What a window has shown of a joint stays known while other windows hide it."""

from __future__ import annotations

from dataclasses import replace

from joint_id_core.results.estimate import Estimate


class Lasting:
    """Keeps the newest fit of a window that shows play, hysteresis or the like.

    These are still there in motion that hides them, and after a joint has changed. They are forgotten as the rest is.

    Args:
        memory_s: time in s after which they are forgotten.
    """

    def __init__(self, memory_s: float) -> None:
        self._memory_s = memory_s
        self._newest: Estimate | None = None

    def on(self, fit: Estimate) -> Estimate:
        """Return a fit of a window, widened by what an earlier one has shown if this one does not show it."""
        if fit.checks is None:
            return fit
        if fit.checks.lasting is not None:
            self._newest = fit
            return fit
        before = self._newest
        if before is None or not 0.0 <= fit.end - before.end <= self._memory_s or before.free != fit.free:
            return fit
        assert before.checks is not None and before.checks.lasting is not None
        texts, excess = (before.checks.texts[0], *fit.checks.texts), fit.checks.excess + before.checks.lasting
        return replace(fit, checks=replace(fit.checks, texts=texts, excess=excess))
