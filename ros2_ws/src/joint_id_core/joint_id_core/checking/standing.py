"""Signals that stand still between samples that change: frozen, or from a slower source."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.clipping import LEAST_CHANGES, cut_runs, long_runs, varies_else
from joint_id_core.checking.finding import REMOVE, SAMPLES, Finding, number, stretches
from joint_id_core.checking.sides import MOTION, way
from joint_id_core.checking.signals import joint_moves, positions
from joint_id_core.data.recording import Recording

RESTS = 0.01  # of its whole way, which a joint at rest does not go
SAME = 0.9  # share of the distances between changes that are the same, if a source is slower


def standing(recording: Recording) -> Iterator[Finding]:
    """Find stretches of equal values of a measured drive that else changes with every sample, while the joint moves.

    A commanded drive that is held for some samples is none. One that is cut off: see `clipping`. Positions and
    velocities that stand still: see `jumps` and `frozen`.
    """
    if not joint_moves(recording):
        return
    for name in ("torque", "current"):
        if not recording.measured(name):
            continue
        known = np.flatnonzero(np.isfinite(recording[name]))
        x = recording[name][known]
        long = long_runs(x)
        if not len(long) or not varies_else(x, long) or len(cut_runs(x)):
            continue
        ends = [(first, last) for first, last in known[long].tolist() if not _rests(recording, first, last)]
        if ends:
            yield Finding(
                f"Channel {name} stands still {number(len(ends), 'time')} while else every sample differs: in samples "
                f"{stretches(recording, ends)}; {REMOVE}",
                (name,),
            )


def _rests(recording: Recording, first: int, last: int) -> bool:
    """Return whether the joint rests from sample `first` to `last`: a drive may then stay the same."""
    names = [n for n in MOTION if recording.measured(n)]
    if not names:
        return False
    time, x = way(recording, names[0])
    begin, end = np.searchsorted(time, recording.time[[first, last]])
    return end > begin and float(np.ptp(x[begin : end + 1])) < RESTS * float(np.ptp(x))


def slower_source(recording: Recording) -> Iterator[Finding]:
    """Find channels that change with every n-th sample only, because their source is slower than the recording.

    These are positions, and a measured current: a torque may be a command that is held.
    """
    for name in [*positions(recording), *(["current"] if recording.measured("current") else [])]:
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


def _ordinal(count: int) -> str:
    return {2: "second", 3: "third"}.get(count, f"{count}th")
