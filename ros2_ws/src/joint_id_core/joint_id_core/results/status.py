"""How an estimation ended."""

from __future__ import annotations

import enum


class Status(enum.StrEnum):
    """How an estimation ended, equal to its text. `advice` tells the user what to do."""

    CONVERGED = "converged"
    POOR_FIT = "poor_fit"
    MAX_ITERATIONS = "max_iterations"
    DIVERGED = "diverged"
    NO_MOTION = "no_motion"
    TOO_SHORT = "too_short"
    MISSING_SIGNAL = "missing_signal"
    DISAGREE = "disagree"
    UNINFORMATIVE = "uninformative"
    BAD_DATA = "bad_data"

    __hash__ = str.__hash__  # that of `Enum` takes ten times as long

    @property
    def advice(self) -> str:
        """What the status means and what to do about it."""
        return _ADVICE[self]

    @property
    def unusable(self) -> bool:
        """Whether there was nothing to fit: the recording, not the model, is the cause."""
        return self in (Status.NO_MOTION, Status.TOO_SHORT, Status.MISSING_SIGNAL, Status.BAD_DATA)

    @property
    def describes(self) -> bool:
        """Whether the model describes the motion."""
        return self in (Status.CONVERGED, Status.DISAGREE)


_ADVICE = {
    Status.CONVERGED: "converged",
    Status.POOR_FIT: "the model does not describe this motion: try another model or friction law, and do not "
    "trust the standard deviations",
    Status.MAX_ITERATIONS: "stopped before it converged: allow more iterations or start nearer to the truth (--set)",
    Status.DIVERGED: "no finite solution: check units, gear ratio and start values",
    Status.NO_MOTION: "no motion in this window: move the joint",
    Status.TOO_SHORT: "too few samples for a fit: record longer or widen the window",
    Status.MISSING_SIGNAL: "a signal that the model needs is missing",
    Status.DISAGREE: "two estimators with different assumptions disagree by more than their intervals: use parameters "
    "that are not named, and for those that are the wide interval, which contains both values",
    Status.UNINFORMATIVE: "this motion shows none of the parameters: move faster, further or for longer",
    Status.BAD_DATA: "the recording contradicts itself or its units: see the message",
}
