"""Inverse dynamics: the drive input that explains a measured motion."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import derivative_of
from joint_id_core.filtering.offline import FilterOptions, complete, differentiate
from joint_id_core.models import Model
from joint_id_core.models.operations import ArrayOps

# Acceleration computed from an encoder is mostly noise above the band in which a joint moves. So predicted and measured
# drive are compared below this frequency, with the same filter for both, as in inverse dynamic identification (Gautier
# 1997). On a public UR3e log, 50 Hz would explain 95.4 % of the shoulder's current, 10 Hz 99.8 %.
DRIVE_BAND_HZ = 10.0
ROUNDING = 1e-6  # relative tolerance of a duration: equal durations except for rounding are not longer


def drive(model: Model, values: dict[str, float], recording: Recording) -> Array | None:
    """Compute the drive input (torque or current) that explains the measured motion (inverse dynamics).

    The derivative of every model is linear in the drive, so the drive follows from the acceleration that it acts on.
    Velocities and accelerations that were not measured come from the Butterworth differentiator.

    Returns:
        The drive at every sample, shape (T,), NaN where the motion is not known. None if the model's drive is a voltage
        or the motion of a state was not recorded.
    """
    if model.torque_drive is None:
        return None
    recording = complete(recording, _band(recording.time, FilterOptions().cutoff_hz))
    wanted = [n for n in (*model.state_names, *model.input_names[1:]) if n not in model.optional_inputs]
    if not all(n in recording for n in wanted):
        return None
    x = [recording[n] for n in model.state_names]
    rest = [recording.channels.get(n, np.zeros(len(recording))) for n in model.input_names[1:]]
    p = SimpleNamespace(**values)
    zero, one = (model.derivative(x, [np.full(len(recording), d), *rest], p, ArrayOps()) for d in (0.0, 1.0))
    for name, f_0, f_1 in zip(model.state_names, zero, one, strict=True):
        rate = derivative_of(name)  # the drive changes only accelerations, so only these rates depend on it
        if rate is not None and rate in recording and np.any(f_1 != f_0):
            return np.asarray((recording[rate] - f_0) / (f_1 - f_0))
    return None


def _band(time: Array, cutoff_hz: float) -> FilterOptions:
    """Return a filter with this cutoff, or with the highest cutoff that the sampling allows with some margin."""
    return FilterOptions(cutoff_hz=min(cutoff_hz, 0.4 / float(np.median(np.diff(time)))))


def drive_errors(time: Array, measured: Array, predicted: Array, band_hz: float = DRIVE_BAND_HZ) -> Array:
    """Return predicted minus measured drive below `band_hz`, over the standard deviation of the measured drive there.

    Samples within two periods 1/band_hz of the ends of the record, or of a long gap, are left out. There the filter
    lacks samples, and the acceleration behind the prediction is inaccurate.

    Returns:
        Errors of shape (T,), NaN where a drive is not known or the sample is left out.
    """
    errors = np.full(len(time), np.nan)
    known = np.flatnonzero(np.isfinite(measured) & np.isfinite(predicted))
    if len(known) < 2:
        return errors
    t, options = time[known], _band(time, band_hz)
    a, b = (differentiate(t, v[known], options)[0] for v in (measured, predicted))
    cuts = np.flatnonzero(np.diff(t) > (1.0 + ROUNDING) * options.max_gap * float(np.median(np.diff(t))))
    first, last = t[np.concatenate([[0], cuts + 1])], t[np.concatenate([cuts, [len(t) - 1]])]
    piece = np.searchsorted(first, t, "right") - 1
    margin = (1.0 + ROUNDING) * 2.0 / options.cutoff_hz
    inner = (t - first[piece] > margin) & (last[piece] - t > margin) & np.isfinite(a) & np.isfinite(b)
    spread = float(np.std(a[inner])) if inner.any() else 0.0
    if spread > 0.0:
        errors[known[inner]] = (b - a)[inner] / spread
    return errors


def drive_r_squared(time: Array, measured: Array, predicted: Array, band_hz: float = DRIVE_BAND_HZ) -> float:
    """Return the coefficient of determination of a predicted drive, from `drive_errors`; NaN without any error."""
    errors = drive_errors(time, measured, predicted, band_hz)
    return 1.0 - float(np.nanmean(errors**2)) if np.isfinite(errors).any() else float("nan")
