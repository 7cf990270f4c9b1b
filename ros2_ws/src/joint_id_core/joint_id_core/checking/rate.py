"""A sampling rate that is too low for the motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import highest_frequency, joint_moves, moves
from joint_id_core.data.recording import Recording

# Samples in a period of the fastest motion. With 10 an inertia comes out 3 to 5 % too small, with 5 up to 15 %.
PER_PERIOD = 10.0
LEAST = 100  # samples; fewer do not show frequencies


def low_rate(recording: Recording) -> Iterator[Finding]:
    """Find a motion that has fewer than `PER_PERIOD` samples in its fastest period."""
    if len(recording) < LEAST or not joint_moves(recording):
        return
    for name, times in (("link_velocity", 0), ("link_position", 1), ("motor_velocity", 0), ("motor_position", 1)):
        if not recording.measured(name) or not moves(recording[name]):
            continue
        seen = np.isfinite(recording[name])
        fastest = highest_frequency(recording.time[seen], recording[name][seen], times)
        rate = 1.0 / recording.period
        if rate < PER_PERIOD * fastest:
            yield Finding(
                f"{rate:.4g} samples/s are few for this motion, which has parts at {fastest:.3g} Hz ({name}): inertia "
                f"comes out too small from fewer than {PER_PERIOD:g} samples a period; record at "
                f"{PER_PERIOD * fastest:.3g} Hz or more",
                (name,),
                about="rate",
            )
        return
