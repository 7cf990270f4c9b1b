"""Samples at which a joint stands still, from its measured signals alone.

A joint that sticks shows nothing of its parameters but a bound of its friction, and smoothed friction lets it creep.
Over some tenths of a second this creep is larger than the noise of an encoder. So samples at rest are left out, and the
filter starts again where motion begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import CHANNELS
from joint_id_core.estimators.shared.initial_state import rough_noise

STILL_S = 0.05  # shortest rest that counts: a reversal is shorter
LEAST = 5  # samples of a rest
NOISY = 8.0  # range of a resting signal over the standard deviation of its noise; of 25 normal numbers it is 4
SLOW = 1e-3  # speed of a resting joint over the typical one: creep under load


def still(
    labels: tuple[str, ...], y: Array, period: float, noise: Mapping[str, float] | None = None
) -> NDArray[np.bool_]:
    """Return True for samples that belong to a rest, shape (T,).

    Args:
        labels: names of the labels.
        y: their values, shape (T, labels), NaN where missing.
        period: of the samples in s.
        noise: standard deviations by label; None takes them from the samples.
    """
    count = max(LEAST, round(STILL_S / period) + 1)
    quiet: NDArray[np.bool_] | None = None
    if len(y) < count:
        return np.zeros(len(y), dtype=bool)
    for name, values in zip(labels, y.T, strict=True):
        kind = name.rpartition("_")[2]
        if kind not in ("position", "velocity"):
            continue
        known = np.isfinite(values)
        row = values[known]
        if len(row) < count:
            continue
        sigma = noise[name] if noise and name in noise else max(np.sqrt(rough_noise(row)), _resolution(row))
        filled = np.interp(np.arange(len(values)), np.flatnonzero(known), row)
        views = np.lib.stride_tricks.sliding_window_view(filled, count)
        calm = _calm(name, sigma, views.max(axis=1) - views.min(axis=1), views.mean(axis=1), count)
        quiet = calm if quiet is None else quiet & calm
    if quiet is None:
        return np.zeros(len(y), dtype=bool)
    # a sample is at rest if any quiet stretch of `count` samples holds it
    return np.convolve(quiet, np.ones(count, dtype=int))[: len(y)] > 0


def _calm(name: str, sigma: float, size: Any, mean: Any, count: int) -> Any:
    """Return whether stretches of `count` samples with this range and mean are those of a joint at rest."""
    speed = SLOW * CHANNELS[name].scale
    if name.endswith("_position"):
        return size <= NOISY * sigma + speed * STILL_S
    return (size <= NOISY * sigma + speed) & (np.abs(mean) <= 4.0 * sigma / np.sqrt(count) + speed)


def _resolution(row: Array) -> float:
    """Return the smallest step of a quantised signal; 0 if its values hardly ever repeat."""
    steps = np.abs(row[1:] - row[:-1])
    moved = steps[steps > 0.0]
    return float(moved.min()) if 0 < len(moved) < 0.9 * len(steps) else 0.0
