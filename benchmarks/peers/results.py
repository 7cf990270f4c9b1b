"""Runs of peers, what counts as converged, and the table of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

OURS = "joint_id"
# A run has come to the truth when all parameters are within the first share of it, and those that the motion shows best
# within the second. An efficient estimator has standard deviations of 0.4 to 0.5 % there at a torque noise of 0.003 Nm.
WITHIN, WITHIN_TIGHT, TIGHT = 0.05, 0.01, ("k_1", "J_m", "J_q")


@dataclass(frozen=True)
class Run:
    """One fit.

    Attributes:
        peer, torque_noise, start: who, on which recording (Nm), from which random start.
        seconds, setup_s, iterations, finished: see `model2.Fit`.
        errors: relative, by parameter; None when there is no result.
        note: why there is no result, or why it is none to trust.
    """

    peer: str
    torque_noise: float
    start: int
    seconds: float = 0.0
    setup_s: float = 0.0
    iterations: int = 0
    finished: bool = False
    errors: Mapping[str, float] | None = None
    note: str = ""

    @property
    def worst(self) -> float:
        """Largest relative error of a parameter; infinite without a result."""
        return max(map(abs, self.errors.values())) if self.errors else float("inf")

    @property
    def worst_tight(self) -> float:
        """Largest relative error among `TIGHT`; infinite without a result."""
        return max(abs(self.errors[name]) for name in TIGHT) if self.errors else float("inf")

    @property
    def converged(self) -> bool:
        """Whether it has come to the truth."""
        return self.worst < WITHIN and self.worst_tight < WITHIN_TIGHT


def table(runs: Sequence[Run], imports: Mapping[str, float]) -> str:
    """A table for each noise of the torque, with a row for each peer; times, steps and errors are medians.

    `imports`: by peer, what its import took in s. Set-up is that and the longest compilation. Times are of the runs
    that converged, then of all; errors are of all.
    """
    lines = []
    for torque_noise in dict.fromkeys(run.torque_noise for run in runs):
        here = [run for run in runs if run.torque_noise == torque_noise]
        ours = _seconds(run for run in here if run.peer == OURS and run.converged)
        lines += [
            f"torque noise {torque_noise:g} Nm",
            f"{'peer':<21}{'converged':>10}{'time':>10}{'ratio':>8}{'all runs':>11}{'set-up':>9}{'steps':>7}"
            f"{'k_1 J_m J_q':>13}{'worst error':>13}",
        ]
        for name in dict.fromkeys(run.peer for run in here):
            mine = [run for run in here if run.peer == name]
            done = [run for run in mine if run.errors is not None]
            notes = ", ".join(f"{note} ({count})" for note, count in Counter(r.note for r in mine).items() if note)
            if not done:
                lines.append(f"{name:<21}{'-':>10}   {notes}")
                continue
            seconds = _seconds(run for run in mine if run.converged)
            # compiled for the first recording, whichever that was
            setup_s = imports.get(name, 0.0) + max(run.setup_s for run in runs if run.peer == name)
            steps = np.median([run.iterations for run in done])
            tight, worst = (float(np.median([getattr(run, kind) for run in done])) for kind in ("worst_tight", "worst"))
            converged = f"{sum(run.converged for run in mine)} of {len(mine)}"
            row = (
                f"{name:<21}{converged:>10}{_text(seconds, ' s'):>10}{_text(seconds / ours, ''):>8}"
                f"{_text(_seconds(done), ' s'):>11}{_text(setup_s, ' s'):>9}{steps:>7.0f}"
                f"{100.0 * tight:>11.2f} %{100.0 * worst:>11.1f} %   {notes}"
            )
            lines.append(row.rstrip())
        lines.append("")
    return "\n".join(lines)


def _seconds(runs: Iterable[Run]) -> float:
    seconds = [run.seconds for run in runs]
    return float(np.median(seconds)) if seconds else float("nan")


def _text(value: float, unit: str) -> str:
    return f"{value:.3g}{unit}" if np.isfinite(value) else "-"
