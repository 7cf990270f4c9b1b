"""Drives that are cut off at the ends of their range."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import equal_runs, joint_moves
from joint_id_core.data.recording import Array, Recording

LONG = 20  # equal values that are no chance in a signal that changes with nearly every sample
CHANGES = 0.95  # share of the other samples that change in such a signal
LEAST_CHANGES = 20
SHORTEST = 3  # equal values that are no chance at an end of the range: two are at the middle of a peak
LEAST_HELD = 8  # of them
DISTINCT = 50  # values of the other samples; of fewer, it is a command in steps
# The way that the signal would have gone beyond the end, over its resolution: a peak that is flat by rounding alone
# goes there by less than one.
BEYOND = 4.0
RAMP = 1e-6  # of a step, by which the steps of a command differ that is made of straight lines


def cut_off(recording: Recording) -> Iterator[Finding]:
    """Find a torque or current that stands at its largest or least value, as no motion makes it."""
    if not joint_moves(recording):
        return
    for name in ("torque", "current"):
        if not recording.measured(name):
            continue
        x = recording[name][np.isfinite(recording[name])]
        runs = cut_runs(x)
        if len(runs):
            ends = np.unique(x[runs[:, 0]])
            share = 100.0 * float(np.mean(np.isin(x, ends)))
            yield Finding(
                f"Channel {name} is cut off at {' and '.join(f'{end:.4g}' for end in ends)}, {share:.2g} % of the "
                "samples: if the drive itself has no such limit, what it did there is not known; record it with a "
                "wider range",
                (name,),
            )


def cut_runs(x: Array) -> NDArray[np.int64]:
    """Return first and last sample of each run of equal values (T,) at which a signal is cut off, shape (runs, 2)."""
    runs = equal_runs(x)
    none = runs[:0]
    at_end = np.isin(x[runs[:, 0]], (x.max(), x.min())) & (x[runs[:, 0]] != 0.0)  # zero: the drive is off
    runs = runs[at_end & (runs[:, 1] - runs[:, 0] >= SHORTEST - 1)]
    if np.sum(runs[:, 1] - runs[:, 0]) < LEAST_HELD or not varies_else(x, runs):
        return none
    first, last = runs[(runs[:, 0] >= SHORTEST) & (runs[:, 1] < len(x) - SHORTEST)].T
    if not len(first):
        return none
    slope = (np.abs(x[first] - x[first - SHORTEST]) + np.abs(x[last + SHORTEST] - x[last])) / (2.0 * SHORTEST)
    beyond = slope * (last - first) / 4.0  # of a parabola with these slopes
    steps = np.abs(np.diff(x))
    return runs if float(np.median(beyond)) > BEYOND * float(steps[steps > 0.0].min()) else none


def long_runs(x: Array) -> NDArray[np.int64]:
    """Return first and last sample of each long run of equal values (T,), shape (runs, 2)."""
    runs = equal_runs(x)
    return runs[runs[:, 1] - runs[:, 0] >= LONG]


def varies_else(x: Array, runs: NDArray[np.int64]) -> bool:
    """Return whether a signal (T,) changes with nearly every sample, but for runs of equal values, as sensors do."""
    others = len(x) - 1 - int(np.sum(runs[:, 1] - runs[:, 0]))
    steps = np.abs(np.diff(x))
    if others < LEAST_CHANGES or np.count_nonzero(steps) < CHANGES * others:
        return False
    edges = np.bincount(runs[:, 0], minlength=len(x) + 1) - np.bincount(runs[:, 1] + 1, minlength=len(x) + 1)
    outside = x[np.cumsum(edges)[:-1] == 0]
    if len(np.unique(outside)) < DISTINCT:
        return False
    moved = steps[steps > 0.0]
    few, usual, many = np.percentile(moved, [25.0, 50.0, 75.0])
    alike = many - few < RAMP * usual + 1.5 * moved.min()  # rounding makes two steps of one
    return not alike and bool(np.median(np.abs(np.diff(outside, 2))) > RAMP * usual)
