"""Stretches of a recording in which a channel is far noisier than in all the rest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import SAMPLES, Finding
from joint_id_core.checking.signals import MAD, SECOND, joint_moves
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import BESIDE

WINDOW = 25  # samples whose noise is told
LEAST, MOST = 2, 0.3  # windows of a burst, and share of the recording that all bursts are: more is its nature
TIMES = 4.0  # noise of a burst over the largest of all other windows
WHITE = -0.4  # largest autocorrelation of second differences of noise (white noise: -2/3); that of a motion is near 1


def bursts(recording: Recording) -> Iterator[Finding]:
    """Find bursts of noise in a joint that moves; a motion that begins, or a drive that steps, is none."""
    if not joint_moves(recording):
        return
    for name in recording.channels:
        if recording.measured(name) and name not in BESIDE:
            known = np.flatnonzero(np.isfinite(recording[name]))
            for first, last, times in _found(recording[name][known]):
                i, j = int(known[first]), int(known[last])
                yield Finding(
                    f"Channel {name} is {times:.2g} times as noisy as elsewhere in samples {i} to {j} "
                    f"({recording.time[i]:.6g} to {recording.time[j]:.6g} s): check sensor and cable, and leave this "
                    "part out (--start, --end, or empty cells)",
                    (name,),
                    about=SAMPLES,
                    samples=(i, j),
                )


def _found(x: Array) -> list[tuple[int, int, float]]:
    """Return first and last sample of each burst in a channel (T,), and how much noisier it is; none if unsure."""
    count = len(x) // WINDOW
    if count * MOST < LEAST:
        return []
    bends = np.diff(x, 2)[: (count - 1) * WINDOW].reshape(-1, WINDOW)
    levels = MAD / SECOND * np.median(np.abs(bends), axis=1)
    usual = float(np.quantile(levels, 1.0 - MOST))
    if not usual > 0.0:  # a drive in steps, or a coarse sensor
        return []
    loud = levels > TIMES * usual
    beside = loud.copy()  # windows at the edges of a burst are half of it
    beside[1:] |= loud[:-1]
    beside[:-1] |= loud[1:]
    if not loud.any() or np.mean(loud) > MOST or levels[loud].min() < TIMES * levels[~beside].max(initial=0.0):
        return []
    quiet = float(np.median(levels[~beside])) if not beside.all() else 0.0
    if not quiet > 0.0:  # a sensor that repeats its values while the joint is slow
        return []
    runs = _runs(loud)
    if any(b - a + 1 < LEAST or not _white(bends[a : b + 1].ravel()) for a, b in runs):
        return []
    return [(a * WINDOW, (b + 1) * WINDOW - 1, float(np.median(levels[a : b + 1])) / quiet) for a, b in runs]


def _runs(which: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(int))).reshape(-1, 2)
    return [(int(a), int(b) - 1) for a, b in edges]


def _white(bends: Array) -> bool:
    """Return whether second differences are those of noise."""
    return float(bends[1:] @ bends[:-1] / (bends @ bends)) < WHITE
