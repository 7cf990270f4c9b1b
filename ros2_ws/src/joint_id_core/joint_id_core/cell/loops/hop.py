"""What every hop of a live joint takes beside its filter, compiled like `loops.information`.

A hop has ten samples and some ten parameters. In NumPy each of these functions takes ten to twenty calls, which cost
more than the work itself.
"""

from __future__ import annotations

import math

from joint_id_core.cell.loops.arrays import Matrix, Vector


def arrange(signals: Matrix, u: Matrix, y: Matrix) -> float:
    """Write signals (inputs + labels, T) to inputs u (T, inputs) and labels y (T, labels).

    Return 1 if all samples can be used as they are; 0 if an input is missing, or if a label may be frozen, because it
    repeats a zero (see `estimators.shared.fit_data.without_frozen`).
    """
    inputs, usable = u.shape[1], 1.0
    for t in range(len(u)):
        for k in range(inputs):
            u[t, k] = signals[k, t]
            if math.isnan(u[t, k] - u[t, k]):  # not finite
                usable = 0.0
        for k in range(y.shape[1]):
            y[t, k] = signals[inputs + k, t]
            if t > 0 and y[t, k] == 0.0 and y[t - 1, k] == 0.0:
                usable = 0.0
    return usable


def lead(
    begin: float,
    begin_u: Vector,
    times: Vector,
    inputs: Matrix,
    labels: Matrix,
    period: float,
    time: Vector,
    u: Matrix,
    y: Matrix,
    gap: Vector,
) -> float:
    """Put the sample before in front of a stretch of T samples, as `loops.tracking.track` takes them.

    Return the longest step in s, 0 without a sample.

    Inputs:
        begin, begin_u (NU): instant and inputs of the sample before.
        times (T), inputs (T, NU), labels (T, NY): the stretch; the samples come every `period` s.

    Outputs:
        time (1 + T), u (1 + T, NU), y (1 + T, NY): with the sample before, without its labels.
        gap (1 + T): number of samples that are missing after each of them.
    """
    longest = 0.0
    time[0] = begin
    for k in range(u.shape[1]):
        u[0, k] = begin_u[k]
    for k in range(y.shape[1]):
        y[0, k] = math.nan
    for t in range(len(times)):
        time[t + 1] = times[t]
        for k in range(u.shape[1]):
            u[t + 1, k] = inputs[t, k]
        for k in range(y.shape[1]):
            y[t + 1, k] = labels[t, k]
        step = time[t + 1] - time[t]
        longest = max(longest, step)
        gap[t] = max(0.0, math.floor(step / period + 0.5) - 1.0)
    gap[len(times)] = 0.0
    return longest


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
