"""Size of the noise of a channel, whether it moves, and how fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS

MAD = 1.4826  # standard deviation of normal noise over the median of its size
SECOND = 6.0**0.5  # standard deviation of second differences of white noise, over its own
# Span of a channel over its typical size, from which the joint goes somewhere. Those of a UR3e that stand while the
# shoulder moves span 0.0005 rad and 0.04 rad/s.
GOES = {"position": 0.01, "velocity": 0.1}
# White noise spans 6 to 9 standard deviations.
MOVES = 25.0  # span over noise from which a channel moves
ABOVE_NOISE = 25.0  # power of a frequency over the median of the noise, from which it is of the motion: noise rarely is
LONGEST = 2**18  # samples of a spectrum: of ten million it took 1.6 GB
FINEST = 10.0  # times as many even instants as samples, at most
SHARE = 0.99  # of the power of the velocity that lies below the highest frequency of the motion


def known(values: Array) -> Array:
    """Return the values of a channel (T,) without NaN."""
    return np.asarray(values[np.isfinite(values)])


def noise(values: Array) -> float:
    """Return the standard deviation of the noise of a channel (T,), at least one step of its sensor; NaN are skipped.

    It is taken from second differences, to which a motion that is sampled well adds little.
    """
    x = known(values)
    if len(x) < 3:
        return 0.0
    bends = np.abs(x[2:] - 2.0 * x[1:-1] + x[:-2])
    return max(MAD * float(np.median(bends)) / SECOND, _rounding(x))


def _rounding(x: Array) -> float:
    """Return the step of a coarse sensor (T,), where most samples differ by at most one; else 0."""
    steps = np.abs(x[1:] - x[:-1])
    moved = steps[steps > 0.0]
    smallest = float(moved.min()) if len(moved) else 0.0
    return smallest if len(moved) and np.count_nonzero(steps < 1.5 * smallest) > 0.5 * len(steps) else 0.0


def moves(values: Array) -> bool:
    """Return whether a channel (T,) varies by far more than its noise."""
    x = known(values)
    return len(x) > 2 and float(np.ptp(x)) > MOVES * noise(x) and float(np.ptp(x)) > 0.0


def joint_moves(recording: Recording) -> bool:
    """Return whether the joint goes somewhere: a joint that stands is shaken by the others, by less than `GOES`."""
    for kind in ("_position", "_velocity"):  # a velocity tells only where there is no position
        names = [n for n in recording.channels if n.endswith(kind) and recording.measured(n)]
        if names:
            return any(goes(n, recording[n]) for n in names)
    return False


def goes(name: str, values: Array) -> bool:
    """Return whether a position or velocity (T,) varies by more than its noise and more than one that is shaken."""
    return moves(values) and float(np.ptp(known(values))) > GOES[name.rpartition("_")[2]] * CHANNELS[name].scale


def positions(recording: Recording) -> list[str]:
    """Return the names of the measured positions of a joint that moves; none of one that stands."""
    if not joint_moves(recording):
        return []
    measured = [n for n in recording.channels if n.endswith("_position") and recording.measured(n)]
    return [n for n in measured if not n.startswith("reference")]


def equal_runs(x: Array) -> NDArray[np.int64]:
    """Return first and last sample of each run of equal values (T,), shape (runs, 2)."""
    same = np.concatenate([[False], x[1:] == x[:-1], [False]])
    return np.flatnonzero(np.diff(same.astype(int))).reshape(-1, 2)


def highest_frequency(time: Array, values: Array, times: int) -> float:
    """Return the frequency in Hz below which 99 % of the power of the velocity lies, without its noise.

    Args:
        time: instants in s, shape (T,).
        values: without NaN, shape (T,).
        times: how often `values` is to be differentiated to be a velocity.

    Of a long recording the part with most motion tells.
    """
    if len(time) > LONGEST:
        first = max(range(0, len(time) - LONGEST + 1, LONGEST), key=lambda k: float(np.ptp(values[k : k + LONGEST])))
        time, values = time[first : first + LONGEST], values[first : first + LONGEST]
    # samples may come many at a time, with hardly a step between them
    period = max(float(np.median(np.diff(time))), float(time[-1] - time[0]) / (FINEST * len(time)))
    even = np.arange(time[0], time[-1], period)
    row = np.interp(even, time, values)
    row = row - np.linspace(row[0], row[-1], len(row)) if times else row - row.mean()
    window = np.hanning(len(row))
    power = np.abs(np.fft.rfft(row * window)) ** 2
    frequency = np.fft.rfftfreq(len(row), period)
    # rounding leaves peaks that the median does not show
    rounding = _rounding(values) ** 2 / 12.0 * float(np.sum(window**2))
    floor = max(float(np.median(power[frequency > 0.75 * frequency[-1]])), rounding)
    velocity = np.where(power > ABOVE_NOISE * floor, power - floor, 0.0) * frequency ** (2 * times)
    total = np.cumsum(velocity)
    return float(frequency[np.searchsorted(total, SHARE * total[-1])]) if total[-1] > 0.0 else 0.0
