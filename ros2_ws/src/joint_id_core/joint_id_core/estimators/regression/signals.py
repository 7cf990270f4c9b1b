"""The motion in a recording, and the band and the samples in which the equations are compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import derivative_of
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.estimators.shared.fit_data import MIN_SAMPLES, FitData, UnusableError
from joint_id_core.filtering.offline import FilterOptions, complete, differentiate
from joint_id_core.results.estimate import Status

NYQUIST_SHARE = 0.8  # highest cutoff over half of the sampling rate
MOVES = 0.99  # share of the power of the velocity that lies below the frequency of the motion
TIMES = 10.0  # band of the equations over this frequency: beyond it, friction is no more what the law says
NOISE_SHARE = 1e-5  # largest power of the noise of the acceleration in the band over that of the acceleration
MOST_NOISE_SHARE = 1e-3  # the same where a short record would have too few samples in a narrower band
SHORT = 2.0  # times as many samples as a regression needs, as those at rest and at the ends are left out
VELOCITY_NOISE_SHARE = 1e-3  # the same of the velocity that friction takes
ABOVE_NOISE = 4.0  # power over that of the noise from which it is of the motion
LEAST_HZ = 1.0
MARGIN = 1.0  # of a stretch that is left out at both ends, in periods of the band: the filter lacks samples there
# A longer rest is left out: the torque of a joint that sticks may have any value. The short ones of a reversal stay: on
# a UR10e, c is 12 % smaller without them, because friction is no straight line over all speeds.
REST_S = 1.0
PER_PERIOD = 5.0  # samples that are kept in one period of the band


@dataclass(frozen=True)
class Bands:
    """Frequencies in Hz.

    Attributes:
        equations: of the low-pass of the equations.
        motion: of the low-pass of all signals, before velocities enter friction.
    """

    equations: float
    motion: float


def bands(data: FitData) -> Bands:
    """Return the bands that a recording allows.

    That of the equations is ten times the frequency below which the joint moves, but no higher than its noise allows:
    the acceleration is the weakest signal, and its noise makes inertias smaller by its share of the power. A short
    record takes more noise if it would have too few samples. That of the motion is as high as the noise of the velocity
    allows: lower, it would blur where friction reverses.
    """
    highest = NYQUIST_SHARE * 0.5 / data.period
    enough = SHORT * MIN_SAMPLES / (PER_PERIOD * (data.time[-1] - data.time[0]))
    wanted, clear = [], []
    for name in data.labels:
        times = {"position": 1, "velocity": 0}.get(name.rpartition("_")[2])
        if times is None:
            continue
        f, signal, noise = _spectrum(data, name, times)
        total = np.cumsum(signal)
        moves = float(f[np.searchsorted(total, MOVES * total[-1])])
        little, most = (_clear(f, signal * f**2, noise * f**2, share) for share in (NOISE_SHARE, MOST_NOISE_SHARE))
        wanted.append(max(min(TIMES * moves, little), min(enough, most)))
        clear.append(_clear(f, signal, noise, VELOCITY_NOISE_SHARE))
    equations = float(np.clip(max(wanted, default=LEAST_HZ), LEAST_HZ, highest))
    return Bands(equations, float(np.clip(min(clear, default=highest), equations, highest)))


def _spectrum(data: FitData, name: str, times: int) -> tuple[Array, Array, Array]:
    """Return frequencies (F,) in Hz, and the power of velocity and of its noise, of a label derived `times` times."""
    time, period = data.time, data.period
    even = np.arange(time[0], time[-1], period)
    known = np.isfinite(data.recording[name])
    row = np.interp(even, data.recording.time[known], data.recording[name][known])
    size = min(len(row), max(64, round(8.0 / period)))
    f, power = scipy.signal.welch(scipy.signal.detrend(row), 1.0 / period, nperseg=size)
    noise = float(np.median(power[f > 0.5 * f[-1]]))
    signal = np.where(power > ABOVE_NOISE * noise, power - noise, 0.0)
    signal[_ends(power, noise) :] = 0.0
    return f, signal * f ** (2 * times), noise * f ** (2 * times)


def _ends(power: Array, noise: float) -> int:
    """Return where the motion ends in a power spectrum (F,): after its peak, the next octave is noise.

    Powers beyond are of noise: in a short record they scatter by their own size, and those of a rounded position have
    peaks, at as many Hz as the joint passes steps of the encoder.
    """
    peak = 1 + int(np.argmax(power[1:]))
    first = np.arange(peak, (len(power) - 1) // 2 + 1)
    sums = np.cumsum(power)
    quiet = np.flatnonzero((sums[2 * first] - sums[first]) < ABOVE_NOISE * noise * first)
    return int(first[quiet[0]]) + 1 if len(quiet) else len(power)


def _clear(f: Array, signal: Array, noise: Array, share: float) -> float:
    """Return the frequency in Hz below which noise has less than this share of the power of the signal."""
    clear = f[np.cumsum(noise) < share * np.sum(signal)]
    return float(clear[-1]) if len(clear) else LEAST_HZ


def motion(data: FitData, cutoff_hz: float) -> Motion:
    """Return states, inputs and rates at all samples, all behind a low-pass with this cutoff.

    Raises:
        UnusableError: a state is neither measured nor follows from a measured position.
    """
    model, recording = data.model, data.recording
    options = FilterOptions(cutoff_hz=cutoff_hz)
    raw = Recording(
        recording.time, {n: v for n, v in recording.channels.items() if n not in recording.derived},
        source=recording.source,
    )  # fmt: skip
    known = complete(raw, options)
    x, rates = {}, {}
    for name in model.state_names:
        if name not in known:
            raise UnusableError(
                Status.MISSING_SIGNAL,
                f"{recording.source} has no {name}: the regression needs every state of {model.name}, measured or as "
                "the derivative of a measured position; use the estimator innovations, or another model",
            )
        smooth, rate = differentiate(known.time, known[name], options, 1)
        x[name] = known[name] if name in known.derived else smooth  # derived ones have passed the filter
        rates[name] = known.channels.get(derivative_of(name) or "", rate)
    zero = np.zeros(len(known))
    u = {s.name: known.channels.get(s.name, recording.channels.get(s.name, zero)) for s in model.inputs}
    u = {s.name: _at_samples(u[s.name]) if s.hold == "zero" else u[s.name] for s in model.inputs}
    return Motion(x, {n: differentiate(known.time, v, options, 0)[0] for n, v in u.items()}, rates)


def _at_samples(held: Array) -> Array:
    """Return what an input that is constant from each sample to the next does at the instants of the samples.

    Such an input acts half a period late, with the gain sinc(w T / 2). The weights have this gain up to (w T)^4.
    """
    before = np.concatenate([held[:1], held[:1], held, held[-1:]])
    return np.asarray((13.0 * (before[2:-1] + before[1:-2]) - before[3:] - before[:-3]) / 24.0)


@dataclass(frozen=True)
class Rows:
    """Samples at which equations are compared: indices (R,), and the number of the stretch of each, (R,)."""

    index: NDArray[np.int64]
    pieces: NDArray[np.int64]


def smoothed(time: Array, values: Array, band_hz: float) -> Array:
    """Return columns (T, k) behind the low-pass of the band, all by the same filter."""
    options = FilterOptions(cutoff_hz=band_hz)
    return np.array([differentiate(time, row, options, 0)[0] for row in values.T]).T


def all_smoothed(
    time: Array, tables: Mapping[str, Array], usable: NDArray[np.bool_], band_hz: float
) -> dict[str, Array]:
    """Return tables of columns (T, k) behind the low-pass of the band, from the usable samples (T,)."""
    table = np.column_stack([*tables.values()])
    table[~usable] = np.nan
    ends = np.cumsum([part.shape[1] for part in tables.values()])
    return dict(zip(tables, np.split(smoothed(time, table, band_hz), ends[:-1], axis=1), strict=True))


def rows(data: FitData, usable: NDArray[np.bool_], band_hz: float) -> Rows:
    """Return the usable samples (T,) in motion away from the ends of every stretch, as many as the band needs."""
    time = data.recording.time
    moving = usable.copy()
    for begin, end in _runs(data.rest):
        if data.time[end - 1] - data.time[begin] > REST_S:
            moving &= (time < data.time[begin]) | (time > data.time[end - 1])
    index, pieces = [], []
    step = max(1, int(1.0 / (PER_PERIOD * band_hz * data.period)))
    for number, (begin, end) in enumerate(_runs(moving)):
        part = np.arange(begin, end)
        inner = part[(time[part] > time[begin] + MARGIN / band_hz) & (time[part] < time[end - 1] - MARGIN / band_hz)]
        index.append(inner[::step])
        pieces.append(np.full(len(index[-1]), number))
    none = np.zeros(0, dtype=np.int64)
    return Rows(np.concatenate([none, *index]), np.concatenate([none, *pieces]))


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(begin, end) for begin, end in edges.reshape(-1, 2).tolist()]
