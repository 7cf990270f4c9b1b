"""What every hop of a live joint takes beside its filter, compiled like `loops.information`.

A hop has ten samples and some ten parameters. In NumPy each of these functions takes ten to twenty calls, which cost
more than the work itself.
"""

from __future__ import annotations

import math

from joint_id_core.cell.loops.arrays import Indices, Matrix, Vector


def lead(
    signals: Matrix,
    times: Vector,
    period: float,
    checked: float,
    first: int,
    time: Vector,
    u: Matrix,
    y: Matrix,
    gap: Vector,
) -> float:
    """Write T samples behind those that are there, as `loops.tracking.track` takes them.

    Return the longest step in s, 0 without a sample. NaN if the samples cannot be used as they are: an input is
    missing, or a label may be frozen, because it repeats a zero (see `estimators.shared.fit_data.without_frozen`).

    Inputs:
        signals (NU + NY, T), times (T): inputs and labels, which come every `period` s.
        checked: 1 if it is known that they can be used.
        first: row of the sample before, of which `time` is filled.

    Outputs, of which the rows after `first` are filled:
        time (rows), u (rows, NU), y (rows, NY): the samples.
        gap (rows): number of samples that are missing after each of them; row `first` is filled, too.
    """
    longest, usable, inputs = 0.0, 1.0, u.shape[1]
    for t in range(len(times)):
        row = first + 1 + t
        time[row] = times[t]
        for k in range(inputs):
            u[row, k] = signals[k, t]
            if math.isnan(u[row, k] - u[row, k]):  # not finite
                usable = checked
        for k in range(y.shape[1]):
            y[row, k] = signals[inputs + k, t]
            if t > 0 and y[row, k] == 0.0 and y[row - 1, k] == 0.0:
                usable = checked
        step = time[row] - time[row - 1]
        longest = max(longest, step)
        gap[row - 1] = max(0.0, math.floor(step / period + 0.5) - 1.0)
        gap[row] = 0.0
    return longest if usable > 0.0 else math.nan


def curve(signals: Matrix, times: Vector, rows: Indices, before: Matrix, even: float) -> None:
    """Change inputs so that straight lines between them have the mean of their curves: see `models.curved_inputs`.

    Inputs:
        signals (S, T), times (T): samples; those in `rows` (R) are changed.
        before (1 + R, 2): instants and values of the two samples before, NaN where there was none; updated to those of
            the newest two.
        even: difference of two steps over the newer one, up to which three samples tell the curve.
    """
    for t in range(len(times)):
        step = times[t] - before[0, 1]
        for k in range(len(rows)):
            value = signals[rows[k], t]
            bend = (value - 2.0 * before[1 + k, 1] + before[1 + k, 0]) / 12.0
            if abs(step - (before[0, 1] - before[0, 0])) < even * step and not math.isnan(bend - bend):
                signals[rows[k], t] = value - bend
            before[1 + k, 0] = before[1 + k, 1]
            before[1 + k, 1] = value
        before[0, 0] = before[0, 1]
        before[0, 1] = times[t]


def physical(
    z: Vector,
    covariance: Matrix,
    lower: Vector,
    upper: Vector,
    logarithm: Vector,
    values: Vector,
    sigma: Vector,
    found: Matrix,
) -> None:
    """Convert an estimate from estimation coordinates to physical values (see `estimators.innovations.belief`).

    Inputs:
        z (k), covariance (k, k): the estimate.
        lower (k), upper (k): bounds of z.
        logarithm (k): 1 where z is a logarithm, 0 where it is the value itself.

    Outputs:
        values (k), sigma (k), found (k, k): values within the bounds, standard deviations and covariance.
    """
    k = len(z)
    for i in range(k):
        values[i] = min(max(z[i], lower[i]), upper[i])
        if logarithm[i] > 0.0:
            values[i] = math.exp(values[i])
    for i in range(k):
        for j in range(k):
            slope = (values[i] if logarithm[i] > 0.0 else 1.0) * (values[j] if logarithm[j] > 0.0 else 1.0)
            found[i, j] = covariance[i, j] * slope
        sigma[i] = math.sqrt(found[i, i])


def apart(
    values: Vector, sigma: Vector, positive: Vector, told: Matrix, told_sigma: Matrix, far: float, least: float
) -> float:
    """Return 1 if a parameter differs from an earlier value by more than `far` standard deviations, else 0.

    Positive parameters are compared by their logarithms, which must differ by more than `least`, too.

    Inputs:
        values (p), sigma (p): of today; updated to those of the logarithms. NaN in `sigma`: not compared.
        positive (p): 1 for a positive parameter, else 0.
        told (n, p), told_sigma (n, p): earlier ones, as they were updated then.
    """
    found = 0.0
    for i in range(len(values)):
        if positive[i] > 0.0 and sigma[i] >= 0.0:
            sigma[i] /= values[i]
            values[i] = math.log(values[i])
        for t in range(len(told)):
            away = abs(values[i] - told[t, i])
            spread = math.sqrt(sigma[i] * sigma[i] + told_sigma[t, i] * told_sigma[t, i])
            if away > far * spread and not (positive[i] > 0.0 and away < least):
                found = 1.0
    return found
