"""Time stamps that are those of the arrival and not of the measurement."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import MAD, joint_moves
from joint_id_core.data.recording import Array, Recording

SCATTER = 0.02  # of the period, from which steps of time scatter
SMOOTHER = 0.5  # bends of the motion at even times, over those at its own times
LEAST = 100  # samples


def uneven_stamps(recording: Recording) -> Iterator[Finding]:
    """Find times that scatter while the motion is smoother at even ones."""
    if not joint_moves(recording):
        return
    steps = np.diff(recording.time)
    period = recording.period
    even = np.abs(steps - period) < 0.75 * period  # no gap
    scatter = MAD * float(np.median(np.abs(steps[even] - period))) if even.any() else 0.0
    if scatter < SCATTER * period:
        return
    for name in ("link_position", "motor_position"):
        if not recording.measured(name):
            continue
        x = recording[name]
        usable = even[1:] & even[:-1] & np.isfinite(x[2:] + x[1:-1] + x[:-2])
        if np.count_nonzero(usable) < LEAST:
            continue
        own = _bends(recording.time, x)[usable]
        alike = _bends(np.arange(len(x), dtype=float), x)[usable]
        if np.median(alike) < SMOOTHER * np.median(own):
            yield Finding(
                f"The times scatter by {1e3 * scatter:.2g} ms, but {name} is smoother at even times, every "
                f"{1e3 * period:.4g} ms: they are those of the arrival; give even times, or record those of the robot"
            )
            return


def _bends(time: Array, x: Array) -> Array:
    """Return how far each inner value (T - 2,) is off a line through its neighbours."""
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    return np.asarray(np.abs(x[1:-1] - (1.0 - share) * x[:-2] - share * x[2:]))
