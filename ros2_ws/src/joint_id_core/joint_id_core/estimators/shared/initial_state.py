"""Start values of a fit: the start state and its standard deviation, rough states, rough noise levels."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import scipy  # whose parts load when used

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import across_gear, integral_of, side_of

if TYPE_CHECKING:
    from joint_id_core.estimators.shared.fit_data import FitData

TWIST_SPREAD = 0.02  # rad: more than any harmonic drive twists, seen at the link
TWIST_RATE_SPREAD = 0.5  # rad/s
ALIKE = 1e-6  # relative difference of motion below which two stretches of a record count as equal
STILL = 1e-8  # fraction of a signal's span; a step that is no larger is rounding, not a change of the signal
_ACROSS_SPREAD = {
    "motor_position": TWIST_SPREAD,
    "link_position": TWIST_SPREAD,
    "motor_velocity": TWIST_RATE_SPREAD,
    "link_velocity": TWIST_RATE_SPREAD,
}


def start_state(data: FitData, at: int = 0, p: Array | None = None) -> tuple[Array, Array]:
    """Return the prior of the state at sample `at`, before its labels: mean (n,) and standard deviation (n,).

    A measured state starts at its first label. Its standard deviation is far above the range of the label, so that
    the label is not counted twice. An unmeasured state starts from the first of these that exists:

    - the state on the other side of the gear, with the standard deviation of the twist,
    - for a velocity, the slope of its measured position,
    - a derived channel of the recording,
    - zero.

    In the last three cases the standard deviation is the typical size of the signal, that of a torque the largest one
    of the drive.
    With parameters `p` near the truth, an unmeasured motor position is shifted by the twist under the present drive.
    """
    model, recording = data.model, data.recording
    ratio = model.gear_ratio(dict(zip(model.parameter_names, data.p.tolist(), strict=True)))
    first = {}
    for k, name in enumerate(data.labels):
        nearest = at
        if not np.isfinite(data.y[at, k]):
            seen = np.flatnonzero(data.present[:, k])
            if not seen.size:  # possible in a part of a record
                continue
            nearest = int(seen[min(int(np.searchsorted(seen, at)), len(seen) - 1)])
        first[name] = (float(data.y[nearest, k]), 10.0 * float(data.span[k]) + 1e-9)
    known = dict(first)
    for k, name in enumerate(model.input_names):
        known.setdefault(name, (float(data.u[at, k]), 0.0))
    mean, spread = [], []
    for signal in model.states:
        name = signal.name
        if name in first:
            value, sd = first[name]
        elif (across := across_gear(name)) in known and side_of(name) == "motor" and name in _ACROSS_SPREAD:
            value, sd = ratio * known[across][0], ratio * _ACROSS_SPREAD[name]
            if name == "motor_position" and p is not None:
                value += ratio * _twist(data, at, p)
        elif across in known and side_of(name) == "link":
            value, sd = known[across][0] / ratio, _ACROSS_SPREAD.get(name, signal.scale)
        elif (position := integral_of(name)) in first:
            # Coulomb friction linearised at a wrong velocity would make the first labels look impossible.
            value, sd = _slope(data, position, at), signal.scale
        elif name in recording and np.isfinite(recording[name]).any():
            finite = np.isfinite(recording[name])
            nearest = int(np.argmin(np.abs(recording.time[finite] - data.time[at])))
            value, sd = float(recording[name][finite][nearest]), signal.scale
        else:
            value, sd = 0.0, _largest_torque(data) if signal.unit == "Nm" else signal.scale
        mean.append(value)
        spread.append(sd)
    return np.array(mean), np.array(spread)


def _largest_torque(data: FitData) -> float:
    """Return the largest torque of the drive in Nm, at the link; a positive number if there is none."""
    model, values = data.model, dict(zip(data.model.parameter_names, data.p.tolist(), strict=True))
    if model.torque_drive is None:
        return 1.0
    drive = float(np.max(np.abs(data.u[:, model.input_names.index(model.torque_drive)])))
    return model.gear_ratio(values) * model.torque_constant(values) * drive or 1.0


def _twist(data: FitData, at: int, values: Array) -> float:
    """Return the twist in rad at which the spring of the gear balances the drive at sample `at`.

    A cubic spring is several times stiffer under load than without load. Linearised at zero twist, it would make the
    first labels look impossible to the filter.
    """
    model = data.model
    if model.torque_drive is None:
        return 0.0
    drive = float(np.mean(data.u[at : at + 4, model.input_names.index(model.torque_drive)]))
    velocity = acceleration = 0.0
    if "motor_velocity" in data.labels:
        w = data.y[at : at + 8, data.labels.index("motor_velocity")]
        if np.isfinite(w).sum() > 1:
            velocity, acceleration = float(np.nanmean(w)), _slope(data, "motor_velocity", at)
    p = SimpleNamespace(**dict(zip(model.parameter_names, values.tolist(), strict=True)))
    return float(np.clip(model.twist_under(drive, velocity, acceleration, p), -TWIST_SPREAD, TWIST_SPREAD))


def rough_states(data: FitData) -> Array:
    """Return rough states at every sample, shape (T, n), from the record alone, without the model.

    Sources, in this order: labels and derived channels, the other side of the gear, the slope of the position, the
    start state.
    """
    model, recording, time = data.model, data.recording, data.time
    ratio = model.gear_ratio(dict(zip(model.parameter_names, data.p.tolist(), strict=True)))
    known = {name: data.u[:, k] for k, name in enumerate(model.input_names)}
    for name in model.state_names:
        if name in data.labels and len(data.rows[k := data.labels.index(name)]) == len(time):
            known[name] = data.rows[k]
        elif name in recording:
            seen = np.isfinite(recording[name])
            if len(seen) == len(time) and seen.all():
                known[name] = recording[name]
            elif seen.any():
                known[name] = np.interp(time, recording.time[seen], recording[name][seen])
    X = np.empty((len(time), len(model.states)))
    for i, name in enumerate(model.state_names):
        if name in known:
            X[:, i] = known[name]
        elif (across := across_gear(name)) in known:
            X[:, i] = (ratio if side_of(name) == "motor" else 1.0 / ratio) * known[across]
        elif (position := integral_of(name)) in known:
            X[:, i] = scipy.signal.savgol_filter(known[position], 9, 2, deriv=1, delta=data.period)
        else:
            X[:, i] = start_state(data)[0][i]
    return X


def busiest(data: FitData, length: int) -> int:
    """Return the first sample of the stretch of `length` samples with the most motion.

    Motion is the sum of the variances of inputs and labels, each relative to its variance in the whole record.
    """
    every, last = max(1, length // 32), len(data.time) - length
    signals, length = np.concatenate([data.u[::every], data.y[::every]], axis=1).T, length // every
    known = np.isfinite(signals)
    if known.all():
        signals = signals - signals.mean(axis=1, keepdims=True)
    else:
        signals = np.where(known, signals - np.nanmean(signals, axis=1, keepdims=True), 0.0)
    total = np.einsum("kt,kt->k", signals, signals) / signals.shape[1]
    scaled = signals[total > 0.0] / np.sqrt(total[total > 0.0])[:, None]
    first = np.arange(0, signals.shape[1] - length + 1, max(1, length // 2))
    stretches = np.lib.stride_tricks.sliding_window_view(scaled, length, axis=1)[:, first]
    motion = stretches.var(axis=2).sum(axis=0)
    most = motion.max() * (1.0 - ALIKE)  # if the motion repeats, take its first period
    return min(every * int(first[np.argmax(motion >= most)]), last)


def _slope(data: FitData, name: str, at: int) -> float:
    """Return the slope of a straight line through eight values of a label from sample `at` on, in its unit per s."""
    values = data.y[:, data.labels.index(name)]
    seen = np.flatnonzero(np.isfinite(values[at:]))[:8] + at
    if len(seen) < 2:
        return 0.0
    time = data.time[seen] - data.time[seen].mean()
    return float(time @ values[seen] / (time @ time))


def rough_noise(values: Array) -> float:
    """Return a rough noise variance of a signal from its measured samples.

    Third differences remove nearly all of a smooth motion and multiply white noise by sqrt(20). The median makes the
    result insensitive to events such as a reversal of friction.
    """
    if len(values) < 4:
        return 0.0
    third = np.abs(_third(values[1:] - values[:-1]))
    middle = min(
        float(np.partition(third, len(third) // 2)[len(third) // 2]), 1e100
    )  # damaged data: its square is finite
    return (middle / 0.6745) ** 2 / 20.0


def credible_noise(rows: Array, span: Array) -> Array:
    """Return the smallest and largest credible noise variances of signals, shape (2, k), from rows (k, T) of samples.

    The smallest standard deviation follows from the quantisation if that is visible, else it is 1e-7 of the span (k,)
    of the values. The largest is twice the one that the rms of the third differences gives: noise cannot be larger
    than the signal shows. Without this bound a wrong model could explain its errors by a far too noisy sensor.
    """
    count = rows.shape[1]
    if count < 4:
        return np.outer([1e-24, 4e-24], np.ones(len(rows)))
    first = rows[:, 1:] - rows[:, :-1]
    third = _third(first)
    floor = (1e-7 * span) ** 2 + 1e-24
    steps = np.abs(first)
    moved = steps > STILL * span[:, None]
    still = count - 1 - np.count_nonzero(moved, axis=1)
    for k in np.flatnonzero((still > 0.05 * count) & (still < count - 1)):
        floor[k] = max(floor[k], float(np.min(steps[k, moved[k]])) ** 2 / 12.0 * 0.1)
    return np.array([floor, np.maximum(4.0 / 20.0 * np.einsum("kt,kt->k", third, third) / (count - 3), 4.0 * floor)])


def _third(first: Array) -> Array:
    """Return third differences from first differences."""
    second = first[..., 1:] - first[..., :-1]
    return np.asarray(second[..., 1:] - second[..., :-1])


def input_noise(data: FitData) -> Array:
    """Return a rough noise variance of each input per sample, shape (inputs,).

    The standard deviation is 2 % of the rms of the input, at least 0.1 % of its typical size.
    """
    rms = np.sqrt(np.einsum("tk,tk->k", data.u, data.u) / len(data.u))
    typical = np.array([1e-3 * s.scale for s in data.model.inputs])
    return np.square(np.maximum(0.02 * rms, typical))
