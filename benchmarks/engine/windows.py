"""Updates of a sliding window of Model 2 beside one rollout in C++ of the same window."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from simulated import MODEL_2, RATE, ClosedLoop, Torque, motion

from engine.fits import LABELS, mean_steps, measured, rollout_of
from engine.timing import Times, once
from engine.yardstick import Yardstick, at_steps, rollouts
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Estimate

TARGET = 6.0
WINDOW_S, HOP_S = 2.0, 0.2
BATCH = 20  # samples that come at once
MOTION, SEED = ClosedLoop(4000, Torque(white=0.003)), 1000


@dataclass(frozen=True)
class WindowTimes:
    """Times of one window, each the median of several runs over the record.

    Attributes:
        labels: what was measured.
        end: of the window, s.
        status: of the estimate.
        steps: mean RK4 steps a sample.
        update: the calls of `OnlineIdentifier.update` of a hop, together.
        warm: `fit_innovations` of the window alone, from the estimate of the window before; None where that did not
            converge, so that the fit is not warm.
        cpp: C++ on the window at the same number of steps, right after the update.
    """

    labels: str
    end: float
    status: str
    steps: float
    update: Times
    warm: Times | None
    cpp: Times


def measure(cache: Path, rounds: int) -> list[WindowTimes]:
    """Slide the window over a motion from `cache`, `rounds` times; the first window, a cold fit, does not count."""
    yardstick, found = Yardstick(), []
    true = motion(MOTION, SEED, cache)
    for name, labels in LABELS.items():
        recording = measured(true, SEED, labels)
        fit(MODEL_2, recording.slice(0, 500))  # compiles
        shown = [estimate for estimate, _ in slide(recording)]
        beside, steps = [], []
        for before, estimate in pairwise(shown):
            inside = (estimate.start - 0.5 / RATE, estimate.end + 0.5 / RATE)
            here, seen = true.window(*inside), recording.window(*inside)
            steps.append(mean_steps(estimate, seen, here))
            calls: dict[str, Callable[[], object]] = {**rollouts(rollout_of(yardstick, here), steps[-1])}
            if before.converged:
                calls["warm"] = partial(fit_innovations, MODEL_2, seen, previous=before)
            beside.append(calls)
        times = [one_run(recording, beside) for _ in range(1 + rounds)][1:]
        for k, estimate in enumerate(shown[1:]):
            middle = {kind: Times.median(t[k][kind] for t in times) for kind in times[0][k]}
            found.append(
                WindowTimes(
                    name, estimate.end, estimate.status.value, steps[k],
                    middle["update"], middle.get("warm"), at_steps(middle, steps[k]),
                )
            )  # fmt: skip
    return found


def slide(recording: Recording) -> Iterator[tuple[Estimate, Times]]:
    """The estimates of an identifier that is fed with batches, and what it took for each since the one before."""
    identifier = OnlineIdentifier(MODEL_2, options=OnlineOptions(window_s=WINDOW_S, hop_s=HOP_S))
    wall, cpu = 0.0, 0.0
    for k in range(0, len(recording), BATCH):
        samples = recording.slice(k, k + BATCH)
        estimate, took = once(partial(identifier.update, samples))
        wall, cpu = wall + took.wall_s, cpu + took.cpu_s
        if estimate is not None:
            yield estimate, Times(wall, cpu)
            wall, cpu = 0.0, 0.0


def one_run(recording: Recording, beside: Sequence[Mapping[str, Callable[[], object]]]) -> list[dict[str, Times]]:
    """Time of every update but the first in one run over the record, and of the calls that follow each.

    Those are called twice, of which the second counts: the update has had the caches to itself.
    """
    found = []
    updates = slide(recording)
    next(updates)
    for calls, (_, took) in zip(beside, updates, strict=True):
        times = {"update": took}
        for name, call in calls.items():
            call()
            times[name] = once(call)[1]
        found.append(times)
    return found


def table(rows: Sequence[WindowTimes]) -> str:
    """A row for each choice of labels: medians over the windows, and the mean with the checks of whole windows."""
    lines = [
        f"update of a window of {round(WINDOW_S * RATE)} samples that slides by {HOP_S / WINDOW_S:.0%}; processor time",
        f"{'labels':<31}{'converged':>10}{'steps':>7}{'update':>10}{'mean':>10}{'C++':>10}"
        f"{'update/C++':>12}{'mean/C++':>10}{'warm/C++':>10}   target {TARGET:g}",
    ]
    for name in dict.fromkeys(row.labels for row in rows):
        here = [row for row in rows if row.labels == name]
        update, cpp = (
            np.array([t.cpu_s for t in times]) for times in ([r.update for r in here], [r.cpp for r in here])
        )
        warm = [row.warm.cpu_s / row.cpp.cpu_s for row in here if row.warm is not None]
        ratio = float(np.median(update / cpp))
        converged = f"{sum(row.status == 'converged' for row in here)} of {len(here)}"
        shown = (np.median(update), update.mean(), np.median(cpp))
        lines.append(
            f"{name:<31}{converged:>10}{np.median([r.steps for r in here]):>7.2f}"
            + "".join(f"{f'{1e3 * t:.3g}':>7} ms" for t in shown)
            + f"{ratio:>12.1f}{update.mean() / cpp.mean():>10.1f}"
            f"{np.median(warm):>10.1f}   {'met' if ratio <= TARGET else 'missed'}"
        )
    return "\n".join(lines) + "\n"
