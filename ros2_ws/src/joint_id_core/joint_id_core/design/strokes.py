"""Motions that go there and back within so little that nobody foresees what a fit makes of their friction."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array

# From reversal to reversal, in rad at the link. Of a motion of 4.4 Hz that goes 4.5 mrad to and fro, 30 simulated
# joints had errors of up to 7 promised standard deviations: there the smoothed friction of a fit is always wrong.
SMALL = 0.01
PART = 0.2  # share of the time of such strokes from which it is told
STILL = 1e-4  # rad/s below which the link stands


def small_strokes(position: Array, velocity: Array) -> float:
    """Return the share of the samples, of those that move, in strokes that are small; 0 if none moves.

    Args:
        position, velocity: of the link, shape (T,), in rad and rad/s.
    """
    moving = np.abs(velocity) > STILL
    if not moving.any():
        return 0.0
    turned = np.flatnonzero(np.diff(np.signbit(velocity))) + 1
    begins = np.concatenate([[0], turned])
    counts = np.diff(np.concatenate([begins, [len(position)]]))
    reach = np.maximum.reduceat(position, begins) - np.minimum.reduceat(position, begins)
    return float(np.count_nonzero(moving & np.repeat(reach < SMALL, counts)) / np.count_nonzero(moving))
