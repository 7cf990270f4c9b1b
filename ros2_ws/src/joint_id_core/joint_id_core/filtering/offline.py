"""The Butterworth differentiator: velocities and accelerations from encoder signals of a whole recording.

Positions and velocities pass a Butterworth low-pass (4th order, 50 Hz as in the paper), forwards and backwards for zero
phase. A central difference of 7 points then differentiates them (relative error (w T)^6 / 140, that is 0.04 % at 50 Hz
and 500 Hz sampling). `streaming.py` does the same sample by sample.

With `causal` the filter runs forwards only and delays its output by the group delay. So every channel, measured or not,
goes through the same filter, and the time is shifted back by that delay: all channels describe the stated instant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # whose parts load when used: scipy.signal takes half a second
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option

Indices = NDArray[np.intp]

# Central difference of 7 points, in 1/period: exact for polynomials up to degree 6.
STENCIL = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
HIGHEST = 0.4  # cutoff over the sampling rate: near half of it, the filter would do nothing but delay
SAME = 1e-5  # periods up to which instants are the same: at 500 Hz and 1 rad/s the joint moves by 2e-8 rad in it
REACH = 3  # samples that the stencil reaches to either side

# Position, velocity and acceleration by side of the gear; each one can be computed from the one before.
SIDES = {side: (f"{side}_position", f"{side}_velocity", f"{side}_acceleration") for side in ("motor", "link")}


@lru_cache(maxsize=64)
def _butterworth(order: int, cutoff_hz: float, period: float) -> Array:
    """Return the sections of the low-pass; designing it takes longer than to filter a recording, and many are alike."""
    return np.asarray(scipy.signal.butter(order, cutoff_hz, fs=1.0 / period, output="sos"))


@dataclass(frozen=True)
class FilterOptions:
    """Options of the differentiator."""

    cutoff_hz: float = option(50.0, "cutoff frequency of the low-pass (-3 dB a pass)", "Hz", 0.1, 1e4)
    order: int = option(4, "order of the Butterworth low-pass", "", 1, 8)
    causal: bool = option(False, "filter forwards only: less lag, and measured channels are filtered as well")
    max_gap: float = option(5.0, "longest gap that is bridged; a longer one restarts the filter", "periods", 1.5, 1e3)

    def __post_init__(self) -> None:
        check(self)

    def sections(self, period: float, source: str = "data") -> Array:
        """Return the second-order sections of the filter for a sampling period in s.

        Raises:
            JointIdError: the sampling is too slow for the cutoff; the message says which cutoff is allowed.
        """
        if not self.cutoff_hz < 0.5 / period:
            raise JointIdError(
                f"{source}: cutoff_hz = {self.cutoff_hz:g} Hz needs more than {2 * self.cutoff_hz:g} samples/s, "
                f"there are {1 / period:.4g}: set cutoff_hz below {0.5 / period:.4g} Hz"
            )
        return _butterworth(self.order, self.cutoff_hz, period).copy()  # SciPy filters with a writable array only

    def fitting(self, period: float) -> FilterOptions:
        """Return these options with a cutoff that a sampling period in s allows: at most `HIGHEST` of the rate."""
        return replace(self, cutoff_hz=min(self.cutoff_hz, HIGHEST / period))

    def delay(self, period: float) -> float:
        """Return the group delay of one forward pass at low frequency, in s; `causal` subtracts it from the time."""
        sos = self.sections(period)
        powers = np.arange(3)
        b, a = sos[:, :3], sos[:, 3:]  # group delay at z = 1: sum k b_k / sum b_k - sum k a_k / sum a_k
        return float(period * ((b @ powers) / b.sum(1) - (a @ powers) / a.sum(1)).sum())


def differentiate(
    time: Array, values: Array, options: FilterOptions | None = None, times: int = 1, source: str = "data"
) -> tuple[Array, ...]:
    """Smooth a signal and differentiate it `times` times.

    On evenly spaced samples the smoothed signal equals that of `scipy.signal.sosfiltfilt`. Other samples are first
    interpolated to an even grid by local cubics; results are returned at the given instants only. The interpolation
    also bridges missing samples (NaN, or a gap of at most `max_gap` periods). At longer gaps the signal is split.

    Args:
        time: instants in s, shape (T,), strictly increasing.
        values: shape (T,), NaN where nothing was measured.
        options: options of the filter.
        times: number of derivatives.
        source: name of the data in messages.

    Returns:
        Smoothed signal and its derivatives, 1 + `times` arrays of shape (T,). NaN where `values` is NaN, and in pieces
        too short to filter. Derivatives near the ends of a piece (`settling` samples) are less accurate, since the
        filter has no samples beyond. With `causal` all results lag by `options.delay(period)`.

    Raises:
        JointIdError: the sampling is too slow for the cutoff.
    """
    options = options or FilterOptions()
    results = np.full((1 + times, len(time)), np.nan)
    valid = np.flatnonzero(np.isfinite(values))
    if len(valid) < 2:
        return tuple(results)
    period = float(np.median(np.diff(time)))
    options.sections(period, source)
    for piece in _pieces(time, valid, options.max_gap * period):
        t = time[piece]
        intervals = max(round((t[-1] - t[0]) / period), 1)
        step = (t[-1] - t[0]) / intervals
        padding = _pad_length(options.sections(period))
        if len(piece) < 4 or intervals + 1 <= padding:
            continue
        grid = t[0] + step * np.arange(intervals + 1)
        smooth = _filtered(interpolate(grid, t, values[piece]), options.sections(step), padding, options.causal)
        for k in range(1 + times):
            results[k, piece] = interpolate(t, grid, smooth[padding : padding + len(grid)])
            smooth = np.convolve(smooth, STENCIL[::-1], "same") / step  # only values in the padding are wrong
    return tuple(results)


def smoothed(values: Array, period: float, options: FilterOptions) -> Array:
    """Smooth signals of shape (T, k) on an even grid without gaps, as `differentiate` does; NaN if they are too short.

    Raises:
        JointIdError: the sampling is too slow for the cutoff.
    """
    sections = options.sections(period)
    padding = _pad_length(sections)
    if len(values) <= padding:
        return np.full(values.shape, np.nan)
    return _filtered(values, sections, padding, options.causal)[padding : padding + len(values)]


def complete(recording: Recording, options: FilterOptions | None = None) -> Recording:
    """Add the velocities and accelerations that were not measured, marked as derived.

    A velocity is computed from the position on its side of the gear. An acceleration is computed from the velocity if
    that was measured, else from the position. Measured channels are not changed; only with `causal` they are filtered,
    and the time is shifted back by the filter's delay (see the module). Velocities and accelerations that were derived
    before are computed again. Without `options`, the cutoff is the usual one, or the highest that the sampling allows.

    Raises:
        JointIdError: the sampling is too slow for the cutoff of the options.
    """
    if len(recording) < 2:
        return recording
    options = options or FilterOptions().fitting(recording.period)
    wanted = derivatives(tuple(name for name in recording.channels if recording.measured(name)))
    added: dict[str, Array] = {}
    for origin, names in wanted.items():
        results = differentiate(recording.time, recording[origin], options, len(names), recording.source)
        added.update(zip(names, results[1:], strict=True))
    if options.causal:
        period = recording.period
        filtered = {
            name: differentiate(recording.time, values, options, 0, recording.source)[0]
            for name, values in recording.channels.items()
            if name not in added
        }
        time = recording.time - options.delay(period)
        recording = replace(recording, time=time, channels=filtered, derived=recording.derived - set(added))
    return recording.with_channels(added, derived=True)


def derivatives(measured: tuple[str, ...]) -> Mapping[str, tuple[str, ...]]:
    """Return, by measured channel, the channels to compute from it, in the order of its derivatives."""
    wanted: dict[str, tuple[str, ...]] = {}
    for position, velocity, acceleration in SIDES.values():
        if velocity in measured and acceleration not in measured:
            wanted[velocity] = (acceleration,)
        elif velocity not in measured and position in measured:
            wanted[position] = (velocity,) if acceleration in measured else (velocity, acceleration)
    return wanted


def interpolate(at: Array, time: Array, values: Array) -> Array:
    """Interpolate values (n,), n >= 4, at instants `at` (m,) by local cubics (Lagrange, two samples on either side).

    At the instant of a sample the result is that sample, so samples on an even grid do not change.
    """
    if len(at) == len(time) and np.abs(at - time).max() < SAME * (time[-1] - time[0]) / len(time):
        return values.copy()  # a third of the time of a regression goes into weights that are 1
    first = np.clip(np.searchsorted(time, at, "right") - 2, 0, len(time) - 4)
    result = np.zeros(len(at))
    for j in range(4):
        weight = np.ones(len(at))
        for k in range(4):
            if k != j:
                weight *= (at - time[first + k]) / (time[first + j] - time[first + k])
        result += weight * values[first + j]
    return result


def _pad_length(sos: Array) -> int:
    """Return the samples by which a signal is extended at its ends: the default of `scipy.signal.sosfiltfilt`."""
    return int(3 * (2 * len(sos) + 1 - min((sos[:, 2] == 0).sum(), (sos[:, 5] == 0).sum())))


def _extend_start(x: Array, padding: int) -> Array:
    """Extend signals at their start by the point reflection of their first samples."""
    return np.concatenate([2 * x[0] - x[padding:0:-1], x])


def _filtered(x: Array, sos: Array, padding: int, causal: bool) -> Array:
    """Filter signals along the first axis, extended at both ends; the result keeps the extension."""
    x = _extend_start(_extend_start(x, padding)[::-1], padding)[::-1]
    if not causal:
        return scipy.signal.sosfiltfilt(sos, x, axis=0, padlen=0)
    state = np.multiply.outer(scipy.signal.sosfilt_zi(sos), x[0])
    return scipy.signal.sosfilt(sos, x, axis=0, zi=state)[0]


def _pieces(time: Array, valid: Indices, longest: float) -> Iterator[Indices]:
    """Yield the indices of valid samples, split at gaps longer than `longest` s (with a margin for rounding)."""
    steps = np.diff(time[valid])
    yield from np.split(valid, np.flatnonzero(steps > longest * (1 + 1e-6)) + 1)


def settling(sos: Array, accuracy: float = 1e-6) -> int:
    """Return the number of samples after which the impulse response has decayed to a fraction `accuracy`."""
    radius = max(float(np.abs(np.roots(row[3:])).max()) for row in sos)
    length = 2 + math.ceil(2 * math.log(accuracy) / math.log(radius)) if radius > 0 else 2
    impulse = np.zeros(length)
    impulse[0] = 1.0
    tail = np.cumsum(np.abs(scipy.signal.sosfilt(sos, impulse))[::-1])[::-1]
    return int(np.flatnonzero(tail > accuracy * tail[0])[-1]) + 1
