"""Signals that stand still between samples that change: frozen, cut off, or from a slower source."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import REMOVE, SAMPLES, Finding, number, stretches
from joint_id_core.checking.signals import joint_moves, positions
from joint_id_core.data.recording import Array, Recording

LONG = 20  # equal values that are no chance in a signal that changes with nearly every sample
CHANGES = 0.95  # share of the other samples that change in such a signal
SAME = 0.9  # share of the distances between changes that are the same, if a source is slower
LEAST_CHANGES = 20


def standing(recording: Recording) -> Iterator[Finding]:
    """Find stretches of equal values of a measured drive that else changes with every sample.

    A commanded drive that is held for some samples is none. Positions that stand still: see `jumps`.
    """
    if not joint_moves(recording):
        return
    for name in ("torque", "current"):
        if name not in recording.channels or not recording.measured(name):
            continue
        known = np.flatnonzero(np.isfinite(recording[name]))
        x = recording[name][known]
        runs = _runs(x)
        long = runs[runs[:, 1] - runs[:, 0] >= LONG]
        held = int(np.sum(long[:, 1] - long[:, 0]))
        others = len(x) - 1 - held
        if not len(long) or np.count_nonzero(np.diff(x)) < CHANGES * others or others < LEAST_CHANGES:
            continue
        cut = np.isin(x[long[:, 0]], (x.min(), x.max()))
        if len(long) > 1 and cut.all():
            yield Finding(
                f"Channel {name} is cut off at {x.min():.4g} and {x.max():.4g}, {100.0 * held / len(x):.2g} % of the "
                "samples: what the drive did there is not known; record it with a wider range",
                (name,),
            )
        else:
            yield Finding(
                f"Channel {name} stands still {number(len(long), 'time')} while else every sample differs: in samples "
                f"{stretches(recording, [(known[a], known[b]) for a, b in long.tolist()])}; {REMOVE}",
                (name,),
            )


def slower_source(recording: Recording) -> Iterator[Finding]:
    """Find positions that change with every n-th sample only, because their source is slower than the recording."""
    for name in positions(recording):
        changes = np.flatnonzero(np.diff(recording[name]))
        distances = np.diff(changes)
        if len(distances) < LEAST_CHANGES:
            continue
        usual = int(np.median(distances))
        if usual > 1 and np.count_nonzero(distances == usual) > SAME * len(distances):
            rate = 1.0 / recording.period
            yield Finding(
                f"Channel {name} changes with every {_ordinal(usual)} sample only: its source has {rate / usual:.4g} "
                f"samples/s, the recording {rate:.4g}; keep only the samples at which it changes",
                (name,),
                about=SAMPLES,
            )


def _runs(x: Array) -> NDArray[np.int64]:
    """Return first and last sample of each run of equal values (T,), shape (runs, 2)."""
    same = np.concatenate([[False], x[1:] == x[:-1], [False]])
    return np.flatnonzero(np.diff(same.astype(int))).reshape(-1, 2)


def _ordinal(count: int) -> str:
    return {2: "second", 3: "third"}.get(count, f"{count}th")
