"""Whether a joint rests, from its measured signals alone."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import CHANNELS, integral_of

NOISY = 8.0  # range of a resting signal over the standard deviation of its noise; of 100 normal numbers it is 5
SLOW = 1e-3  # speed of a resting joint over the typical one: creep under load
REST_S = 0.2  # time over which a joint must stand still to be called resting


def resting(labels: tuple[str, ...], y: Array, noise: Array, duration: float) -> bool:
    """Return whether no label moves.

    Args:
        labels: names of the labels.
        y: their values over `duration` in s, shape (T, labels), NaN where missing.
        noise: standard deviations of their noise, shape (labels,).
    """
    seen = False
    for name, row, sigma in zip(labels, y.T, noise, strict=True):
        known = row[np.isfinite(row)]
        kind = name.rpartition("_")[2]
        if not len(known) or kind not in ("position", "velocity"):
            continue
        seen, scale = True, CHANNELS[name].scale
        if kind == "position":
            if np.ptp(known) > NOISY * sigma + SLOW * scale * duration:
                return False
        elif abs(float(known.mean())) > 3.0 * sigma / np.sqrt(len(known)) + SLOW * scale and np.ptp(known) > 0.0:
            return False
        elif np.ptp(known) > NOISY * sigma + SLOW * scale:
            return False
    return seen
