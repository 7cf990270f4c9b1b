"""Updates of a sliding window of Model 2 beside one rollout in C++ of the same window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from simulated import MODEL_2, RATE, ClosedLoop, Torque, motion

from engine.fits import LABELS, mean_steps, measured, rollout_of
from engine.timing import Times, in_turn, once
from engine.yardstick import Yardstick, at_steps, rollouts
from joint_id_core.estimate import Estimate
from joint_id_core.estimators import fit
from joint_id_core.estimators.innovations import fit_innovations
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.recording import Recording

TARGET = 6.0
WINDOW_S, HOP_S = 2.0, 0.2
BATCH = 20  # samples that come at once
MOTION, SEED = ClosedLoop(4000, Torque(white=0.003)), 1000


@dataclass(frozen=True)
class WindowTimes:
    """Times of one window.

    Attributes:
        labels: what was measured.
        end: of the window, s.
        status, iterations, steps: see `FitTimes`.
        update: the calls of `OnlineIdentifier.update` of a hop, together, in one run over the record.
        warm: `fit_innovations` alone, from the estimate of the window before; None where that did not converge, so
            that the fit is not warm.
        cpp: C++ on the window at the same number of steps.
    """

    labels: str
    end: float
    status: str
    iterations: int
    steps: float
    update: Times
    warm: Times | None
    cpp: Times


def measure(cache: Path, rounds: int) -> list[WindowTimes]:
    """Slide the window over a motion from `cache`; the first window, a cold fit, does not count."""
    yardstick, found = Yardstick(), []
    true = motion(MOTION, SEED, cache)
    for name, labels in LABELS.items():
        recording = measured(true, SEED, labels)
        fit(MODEL_2, recording.slice(0, 500))  # compiles
        run = slide(recording)
        for (before, _), (estimate, update) in pairwise(run):
            inside = (estimate.start - 0.5 / RATE, estimate.end + 0.5 / RATE)
            here, shown = true.window(*inside), recording.window(*inside)
            steps = mean_steps(estimate, shown, here)
            calls: dict[str, Callable[[], object]] = {**rollouts(rollout_of(yardstick, here), steps)}
            if before.converged:
                calls["warm"] = partial(fit_innovations, MODEL_2, shown, previous=before)
            times = in_turn(calls, rounds)
            found.append(
                WindowTimes(
                    name, estimate.end, estimate.status.value, estimate.iterations, steps, update, times.get("warm"),
                    at_steps(times, steps),
                )
            )  # fmt: skip
    return found


def slide(recording: Recording) -> list[tuple[Estimate, Times]]:
    """The estimates of an identifier that is fed with batches, and what it took for each since the one before."""
    identifier = OnlineIdentifier(MODEL_2, options=OnlineOptions(window_s=WINDOW_S, hop_s=HOP_S))
    found, wall, cpu = [], 0.0, 0.0
    for k in range(0, len(recording), BATCH):
        samples = recording.slice(k, k + BATCH)
        estimate, took = once(partial(identifier.update, samples))
        wall, cpu = wall + took.wall_s, cpu + took.cpu_s
        if estimate is not None:
            found.append((estimate, Times(wall, cpu)))
            wall, cpu = 0.0, 0.0
    return found


def table(rows: Sequence[WindowTimes]) -> str:
    """A row for each choice of labels: medians over the windows, and the longest update."""
    lines = [
        f"update of a window of {round(WINDOW_S * RATE)} samples that slides by {HOP_S / WINDOW_S:.0%}; processor time",
        f"{'labels':<31}{'converged':>10}{'iterations':>11}{'steps':>7}{'update':>11}{'longest':>11}{'warm fit':>11}"
        f"{'C++':>11}{'update/C++':>12}{'warm/C++':>10}   target {TARGET:g}",
    ]
    for name in dict.fromkeys(row.labels for row in rows):
        here = [row for row in rows if row.labels == name]
        fits = [(row.warm, row.cpp) for row in here if row.warm is not None]
        update, warm, cpp = (
            Times.median(t).cpu_s for t in ((r.update for r in here), (f for f, _ in fits), (r.cpp for r in here))
        )
        by_update = float(np.median([row.update.cpu_s / row.cpp.cpu_s for row in here]))
        by_fit = float(np.median([f.cpu_s / c.cpu_s for f, c in fits]))
        converged = f"{sum(row.status == 'converged' for row in here)} of {len(here)}"
        times = "".join(f"{f'{1e3 * t:.3g}':>8} ms" for t in (update, max(r.update.cpu_s for r in here), warm, cpp))
        lines.append(
            f"{name:<31}{converged:>10}{np.median([r.iterations for r in here]):>11.0f}"
            f"{np.median([r.steps for r in here]):>7.2f}{times}{by_update:>12.1f}{by_fit:>10.1f}"
            f"   {'met' if max(by_update, by_fit) <= TARGET else 'missed'}"
        )
    return "\n".join(lines) + "\n"
