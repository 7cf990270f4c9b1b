"""Time stamps that are those of the arrival and not of the measurement."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import MAD, joint_moves
from joint_id_core.data.recording import Array, Recording

SCATTER = 0.02  # of the period, from which steps of time scatter
SMOOTHER = 0.5  # bends of the motion at even times, over those at its own times
LEAST = 100  # samples
BURSTS = 0.2  # median step over the mean one, below which samples come many at a time
ENDS = 90.0  # percentile of the bends in which the ends of bursts show: up to 20 samples at a time
STAMPS = "stamps"  # what the findings are about


def uneven_stamps(recording: Recording) -> Iterator[Finding]:
    """Find times that scatter while the motion is smoother at even ones."""
    if not joint_moves(recording):
        return
    steps = np.diff(recording.time)
    period, mean = recording.period, float(np.mean(steps))
    if period < BURSTS * mean:
        yield from _bursts(recording, mean)
        return
    even = np.abs(steps - period) < 0.75 * period  # no gap
    scatter = MAD * float(np.median(np.abs(steps[even] - period))) if even.any() else 0.0
    if scatter < SCATTER * period:
        return
    for name in ("link_position", "motor_position"):
        if not recording.measured(name):
            continue
        x = recording[name]
        if _smoother(recording.time, x, even[1:] & even[:-1]):
            yield Finding(
                f"The times scatter by {1e3 * scatter:.2g} ms, but {name} is smoother at even times, every "
                f"{1e3 * period:.4g} ms: they are those of the arrival; give even times, or record those of the robot",
                about=STAMPS,
            )
            return


def _bursts(recording: Recording, mean: float) -> Iterator[Finding]:
    """Find samples that come many at a time, of a motion that is smoother at even times."""
    every = np.ones(len(recording) - 2, dtype=bool)
    for name in ("link_position", "motor_position"):
        if recording.measured(name) and _smoother(recording.time, recording[name], every, ENDS):
            yield Finding(
                f"Samples come many at a time: half of the steps of time are at most {1e3 * recording.period:.2g} ms, "
                f"in the mean they are {1e3 * mean:.4g} ms, and {name} is smoother at even times: they are those of "
                "the arrival; give even times, or record those of the robot",
                about=STAMPS,
            )
            return


def _smoother(time: Array, x: Array, usable: NDArray[np.bool_], share: float = 50.0) -> bool:
    """Return whether a signal (T,) is smoother at even times, at the inner samples that are usable (T - 2,).

    What is compared are the percentiles `share` of its bends.
    """
    usable = usable & np.isfinite(x[2:] + x[1:-1] + x[:-2])
    if np.count_nonzero(usable) < LEAST:
        return False
    own, alike = _bends(time, x)[usable], _bends(np.arange(len(x), dtype=float), x)[usable]
    return bool(np.percentile(alike, share) < SMOOTHER * np.percentile(own, share))


def _bends(time: Array, x: Array) -> Array:
    """Return how far each inner value (T - 2,) is off a line through its neighbours."""
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    return np.asarray(np.abs(x[1:-1] - (1.0 - share) * x[:-2] - share * x[2:]))
