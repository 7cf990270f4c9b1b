"""A measured velocity against the measured position on its side of the gear: factor, sign, lag."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.shift import Shift, best_shift
from joint_id_core.checking.signals import highest_frequency, joint_moves, moves
from joint_id_core.data.recording import Array, Recording
from joint_id_core.filtering.offline import interpolate

GAP = 3.0  # periods between two known samples, from which the interval is left out
SMOOTH = 0.1  # of the period of the fastest motion, over which both are averaged
LONGEST_S = 0.1  # lag that is looked for
SAME = 0.9  # share of the variance that position and velocity have in common, to be of one motion
UNSURE = 0.1  # noise of a derivative over its rms, from which the noise may hide that they are
CONTRADICTS = "contradicts"  # what a finding is about: a velocity with a factor or a lag against its position,
UNLIKE = "unlike"  # or of another motion
ROWS = 2000  # instants that are compared at most
EQUAL = 0.2  # difference of a factor from 1 that is no calibration
# Least difference of a factor from 1 that counts; and where noise is less than that. Those of real robots are within
# 0.12 %, by the twist of their gears.
CALIBRATED, CALIBRATED_WITHOUT_NOISE = 0.03, 0.005
NOISE = 1e-3  # share of the variance
# A backward difference, which many controllers send as velocity, is late by half a sample.
LATE = 0.75  # samples
LATE_S = 0.5e-3  # a shorter lag does not matter to any motion of a joint
FACTORS = (
    (np.pi / 180.0, "the position is in degrees, or the velocity was converted twice"),
    (180.0 / np.pi, "the velocity is in degrees/s"),
    (1e3, "time is in milliseconds, or the position in thousands of its unit"),
    (1e6, "time is in microseconds"),
    (1e-3, "the velocity is in thousands of its unit, or the position in milliradians"),
)
ROUNDED = 0.05  # of such a factor
RATIOS = (25.0, 400.0)  # of gears of robots


def velocities(recording: Recording) -> Iterator[Finding]:
    """Find a velocity that contradicts the position on the same side of the gear."""
    for side in ("motor", "link"):
        position, velocity = f"{side}_position", f"{side}_velocity"
        if recording.measured(position) and recording.measured(velocity):
            shift = compared(recording, position, velocity)
            if shift is not None:
                yield from _judged(recording, position, velocity, shift)


def compared(recording: Recording, position: str, velocity: str) -> Shift | None:
    """Return how late a velocity is in s and its factor against the derivative of a position.

    None if they rest, or if noise of the position may hide what they have in common.
    """
    known = np.flatnonzero(np.isfinite(recording[position]) & np.isfinite(recording[velocity]))
    if len(known) < 100 or not joint_moves(recording) or not moves(recording[velocity]):
        return None
    time, q, v = (values[known] for values in (recording.time, recording[position], recording[velocity]))
    period = float(np.median(time[1:] - time[:-1]))
    fastest = highest_frequency(time, v, 0) or 1.0
    half = max(1, round(0.5 * SMOOTH / (fastest * period)))  # of the average, in samples
    most = max(3, int(min(LONGEST_S, 0.25 / fastest) / period))
    even = np.arange(time[0], time[-1], period)
    if len(even) <= 2 * (half + most) + 100 or len(even) > 10 * len(time):
        return None
    rows = _whole_windows(even, time, half + most + 2, period)
    rows = rows[:: max(1, len(rows) // ROWS)]
    if len(rows) < 100:
        return None
    third = np.diff(q, 3)  # which multiplies the variance of white noise by 20
    path = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * (time[1:] - time[:-1]))])
    q, path = interpolate(even, time, q), interpolate(even, time, path)
    width = 2.0 * half * period
    mean = np.zeros(len(even))
    mean[half:-half] = (path[2 * half :] - path[: -2 * half]) / width

    def mean_velocity(late: float) -> Array:
        whole = int(np.floor(late))
        part, at = late - whole, rows + whole
        if part == 0.0:
            return np.asarray(mean[at])
        a, b, c, d = (mean[at + k] for k in (-1, 0, 1, 2))  # a local cubic
        return np.asarray(
            b + 0.5 * part * (c - a + part * (2.0 * a - 5.0 * b + 4.0 * c - d + part * (3.0 * (b - c) + d - a)))
        )

    moved = (q[rows + half] - q[rows - half]) / width
    found = best_shift(mean_velocity, np.column_stack([moved, np.ones(len(rows))]), most)
    if found is None:
        return None
    noise = float(np.std(third)) / math.sqrt(10.0) / width  # of `moved`, or more
    hidden = found.explained < SAME and noise > UNSURE * float(np.std(moved))
    return None if hidden else found.scaled(period)


def _whole_windows(even: Array, time: Array, reach: int, period: float) -> NDArray[np.intp]:
    """Return the indices of the even instants that have no gap within `reach` samples."""
    steps = time[1:] - time[:-1]
    broken = np.zeros(len(even) + 1)
    for k in np.flatnonzero(steps > GAP * period):
        begin, end = np.searchsorted(even, [time[k], time[k + 1]])
        broken[max(0, begin - reach)] += 1.0
        broken[min(len(even), end + reach)] -= 1.0
    free = np.cumsum(broken)[:-1] == 0.0
    free[:reach] = free[len(even) - reach :] = False
    return np.flatnonzero(free)


def _judged(recording: Recording, position: str, velocity: str, shift: Shift) -> Iterator[Finding]:
    factor, channels = float(shift.factors[0]), (position, velocity)
    if shift.explained < SAME:
        yield Finding(
            f"Channel {velocity} is not the derivative of {position}, which explains {100 * shift.explained:.0f} % of "
            f"it: check the columns of both, or leave out {velocity}",
            channels,
            about=UNLIKE,
        )
        return
    if abs(factor - 1.0) > EQUAL:
        yield Finding(
            f"Position and velocity contradict each other: {velocity} is {factor:.4g} times the derivative of "
            f"{position}: {_reason(factor, velocity)}; convert it (--map)",
            channels,
            fatal=True,
        )
    elif abs(factor - 1.0) > (CALIBRATED_WITHOUT_NOISE if shift.explained > 1.0 - NOISE else CALIBRATED):
        yield Finding(
            f"Channel {velocity} is {factor:.4g} times the derivative of {position}: check the factors of both, or "
            f"leave out {velocity}",
            channels,
            about=CONTRADICTS,
        )
    if shift.sure and abs(shift.late) > max(LATE * recording.period, LATE_S):
        word = "late" if shift.late > 0.0 else "early"
        size = f"{1e3 * abs(shift.late):.3g} ms (+- {1e3 * shift.sigma:.1g})"
        yield Finding(
            f"Channel {velocity} is {word} by {size} against {position}: leave out the one that is filtered or sent "
            "with a delay, or correct its times",
            channels,
            about=CONTRADICTS,
        )


def _reason(factor: float, velocity: str) -> str:
    """Return what makes a velocity this many times the derivative of the position."""
    for size, text in FACTORS:
        if abs(abs(factor) / size - 1.0) < ROUNDED:
            return text
    if abs(factor + 1.0) < EQUAL:
        return "one of them has the wrong sign"
    if RATIOS[0] < max(abs(factor), 1.0 / abs(factor)) < RATIOS[1]:
        return "they seem to be on different sides of the gear"
    return f"check the unit and the column of {velocity}"
