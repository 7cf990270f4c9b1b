"""Signals of few steps: rounded by a coarse encoder, or by a file with few digits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import joint_moves
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS

# Steps between the least and the largest value. Fewer are rest; an encoder of 12 bits has 650 of them in a rad.
LEAST, MOST = 8, 200
CHANGES = 20  # at least
SINGLE = 0.4  # share of the changes that are of one step
ON_GRID = 0.01  # of a step
TURNS = 20  # changes in the other direction that a drive makes at least: fewer make it a command in equal steps
ANGLES = ("motor_position", "link_position")
COARSE = "coarse"  # what a finding is about


def coarse(recording: Recording) -> Iterator[Finding]:
    """Find signals whose values lie on a grid of few steps, as motion and its drive do not."""
    angle = any(n in ANGLES and recording.measured(n) for n in recording.channels)
    if angle and not joint_moves(recording):
        return
    for name in recording.channels:
        measured = recording.measured(name) and name.endswith(("_position", "_velocity"))
        drive = name in ("torque", "current") and recording.measured(name)
        turns = TURNS if drive and not recording.measured("voltage") else 0
        if name.startswith("reference") or not (measured or drive):
            continue
        x = recording[name][np.isfinite(recording[name])]
        step = _step(x, turns)
        if step > 0.0:
            yield Finding(
                f"Channel {name} goes in steps of {step:.3g} {CHANNELS[name].unit}, {np.ptp(x) / step:.0f} between its "
                "least and its largest value: too coarse; record its full resolution, with all digits",
                (name,),
                about=COARSE,
            )


def _step(x: Array, turns: int) -> float:
    """Return the step of a signal (T,) that has few of them; 0 if it has not."""
    changes = np.diff(x)
    changes = changes[changes != 0.0]
    if len(changes) < CHANGES or np.count_nonzero(changes[1:] * changes[:-1] < 0.0) < turns:
        return 0.0
    step = float(np.abs(changes).min())
    if not LEAST * step < np.ptp(x) < MOST * step:
        return 0.0
    count = np.abs(changes) / step
    on_grid = bool(np.all(np.abs(count - np.round(count)) < ON_GRID))
    return step if on_grid and float(np.mean(count < 1.5)) > SINGLE else 0.0
