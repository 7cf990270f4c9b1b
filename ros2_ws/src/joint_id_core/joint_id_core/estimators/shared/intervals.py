"""Intervals: in words, and one around two values that disagree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate
from joint_id_core.results.verdict import MAGNITUDE, Verdict

WIDTH = 1.96  # standard deviations of a 95 % interval
INTERVAL = "95 % interval"
ROUNDING = 1e-9  # of a standard deviation
LEAST = 0.1  # least value of a positive parameter between two, over the first one


def interval_text(value: float, sigma: float) -> str:
    """Return the 95 % interval of a value in words."""
    return f"{INTERVAL} {value - WIDTH * sigma:.4g} to {value + WIDTH * sigma:.4g}"


def widened(model: Model, row: ParameterEstimate, sigma: float) -> ParameterEstimate:
    """Return a parameter with a larger standard deviation: `prior` if only its order of magnitude is left."""
    magnitude = model.parameter(row.name).positive and sigma > MAGNITUDE * row.value
    said = interval_text(row.value, sigma) if row.reason.startswith(INTERVAL) else row.reason
    said = f"it lies below about {row.value + 2.0 * sigma:.2g}, more is not known" if magnitude else said
    return replace(row, std_dev=sigma, verdict=Verdict.PRIOR if magnitude else row.verdict, reason=said)


def with_covariance(model: Model, estimate: Estimate, covariance: Array) -> Estimate:
    """Return an estimate with a larger covariance (free, free) of its free parameters."""
    rows = {row.name: row for row in estimate.parameters}
    before, after = np.sqrt(np.diag(estimate.covariance)), np.sqrt(np.diag(covariance))
    if not (wider := after > (1.0 + ROUNDING) * before).any():
        return estimate
    for name, sigma, larger in zip(estimate.free, after.tolist(), wider.tolist(), strict=True):
        row = rows[name]
        if larger:
            estimated = row.verdict is Verdict.ESTIMATED
            rows[name] = widened(model, row, sigma) if estimated else replace(row, std_dev=sigma)
    return replace(estimate, parameters=tuple(rows.values()), covariance=covariance)


def between(
    model: Model, first: ParameterEstimate, second: tuple[float, float], reason: str
) -> ParameterEstimate:  # fmt: skip
    """Return a parameter whose value lies in the middle of two, and whose 95 % interval contains those of both.

    Args:
        model: of the parameter.
        first: the parameter.
        second: another value and its standard deviation.
        reason: that the parameter tells.
    """
    positive, value = model.parameter(first.name).positive, 0.5 * (first.value + second[0])
    if positive:
        value = max(value, LEAST * first.value)
    values = (first.value, first.std_dev), second
    sigma = max(abs(x - value) + WIDTH * deviation for x, deviation in values) / WIDTH
    verdict = Verdict.PRIOR if positive and sigma > MAGNITUDE * value else first.verdict
    return replace(first, value=value, std_dev=sigma, verdict=verdict, reason=reason)
