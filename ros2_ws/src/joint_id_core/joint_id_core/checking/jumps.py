"""Positions that jump: an encoder that wraps, stands still for a while, or gets another zero."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import SAMPLES, Finding, number, places, stretches
from joint_id_core.checking.repeats import late_steps
from joint_id_core.checking.signals import noise, positions
from joint_id_core.data.recording import Array, Recording

FASTER = 6.0  # than any of the steps around, to either side, from which a step is a jump
REACH = 6  # these steps
STEPS = 20.0  # of the noise or resolution; less may be chance
LEAST_SHARE = 0.01  # of the span; less does little harm
BACK = 0.5  # of a jump, by which the position comes back within `REACH` samples, as after an outlier
LONG = 10  # equal values before a jump that are no chance
ALIKE = 0.1  # of their size, by which the jumps of a position that wraps differ


def jumps(recording: Recording) -> Iterator[Finding]:
    """Find steps of a position that no joint makes. Single outliers and short dropouts are left to others."""
    for name in positions(recording):
        known = np.flatnonzero(np.isfinite(recording[name]))
        x = recording[name][known]
        at = sudden(recording.time[known], x)
        first, length = late_steps(recording.time[known], x)  # these are named there
        at = at[~np.isin(at, first - 1 + length)]
        if len(at):
            yield Finding(_said(name, recording, x, known, at), (name,), about=SAMPLES)


def sudden(time: Array, x: Array) -> NDArray[np.int64]:
    """Return the samples before jumps."""
    if len(x) < 4 * REACH:
        return np.zeros(0, dtype=np.int64)
    step = np.diff(x)
    size = np.abs(step)
    resolution = float(np.min(size, where=size > 0.0, initial=np.inf))
    least = max(
        STEPS * noise(x), STEPS * resolution if np.isfinite(resolution) else 0.0, LEAST_SHARE * float(np.ptp(x))
    )
    k = np.flatnonzero(size > least)  # few: what is around is looked at for these alone
    k = k[(k >= REACH) & (k < len(step) - REACH) & (x[k] != 0.0) & (x[k + 1] != 0.0)]
    beside = k[:, None] + np.array([n for n in range(-REACH, REACH + 1) if n])
    speed = np.abs(step[beside]) / (time[beside + 1] - time[beside])
    found = k[size[k] > FASTER * speed.max(axis=1, initial=0.0) * (time[k + 1] - time[k])]
    back = np.array([np.abs(x[j + 2 : j + 2 + REACH] - x[j]).min() < BACK * abs(step[j]) for j in found], dtype=bool)
    came = np.array([np.abs(x[j - REACH : j] - x[j + 1]).min() < BACK * abs(step[j]) for j in found], dtype=bool)
    return found[~(back | came)]


def _said(name: str, recording: Recording, x: Array, known: NDArray[np.int64], at: NDArray[np.int64]) -> str:
    """Return in words what the jumps after the samples `at` are."""
    sizes = np.abs(x[at + 1] - x[at])
    begins = [_first_equal(x, k) for k in at.tolist()]
    if all(k - begin >= LONG for k, begin in zip(at.tolist(), begins, strict=True)):
        stands = stretches(recording, list(zip(known[begins].tolist(), known[at].tolist(), strict=True)))
        return f"Channel {name} stands still in samples {stands} and jumps then: the sensor froze; remove these samples"
    where = places(recording, known[at + 1])
    if len(at) > 1 and np.ptp(sizes) < ALIKE * sizes.max() and float(np.ptp(x)) < (1.0 + ALIKE) * sizes.max():
        return f"Channel {name} wraps by {np.median(sizes):.4g} rad, {number(len(at), 'time')}: {where}; unwrap it"
    return (
        f"Channel {name} jumps by up to {sizes.max():.3g} rad, {number(len(at), 'time')}: {where}; an encoder that "
        "slips or gets another zero does so: fit the parts by themselves (--start, --end)"
    )


def _first_equal(x: Array, k: int) -> int:
    """Return the first of the equal values that end with sample k."""
    while k > 0 and x[k - 1] == x[k]:
        k -= 1
    return k
