"""Whether a saved estimate can be true: people edit files, and disks damage them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from joint_id_core.data.signals import Parameter
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.models import MODELS
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Verdict

LARGEST = 1e30  # no constant of a joint comes near it, in its SI unit


def check(estimate: Estimate) -> None:
    """Check an estimate, and against the table of its model if that is one of `MODELS` and not the user's own.

    Raises:
        JointIdError: a parameter is unknown, missing or there twice, or one of its numbers or its unit cannot be true.
    """
    names = list(estimate.values)
    if len(names) < len(estimate.parameters) or len(set(estimate.free)) < len(estimate.free):
        raise damaged("a parameter is in it twice")
    table = _table(estimate)
    known = names if table is None else table
    for name in (*names, *estimate.free):
        if name not in known:
            raise damaged(f"model {estimate.model} has no parameter {name!r}{close_to(name, known)}")
    for name in known:
        if name not in names:
            raise damaged(f"parameter {name} is missing")
    for row in estimate.parameters:
        if table is not None:
            _check_value(estimate, row, table[row.name])
        estimated = row.verdict is Verdict.ESTIMATED and row.name in estimate.free
        if estimated and not abs(row.value) <= LARGEST:
            raise damaged(f"the value of {row.name}, which is estimated, is {row.value:g}")
        if row.std_dev < 0.0 or row.std_dev > LARGEST or (estimated and not row.std_dev > 0.0):
            raise damaged(f"the standard deviation of {row.name}, which is {row.verdict.value}, is {row.std_dev:g}")
    _check_covariance(estimate)


def damaged(what: str) -> JointIdError:
    """Return the error for an estimate that no fit can have made."""
    return JointIdError(f"the estimate is incomplete or damaged: {what}: fit and save it again")


def _table(estimate: Estimate) -> Mapping[str, Parameter] | None:
    """Return the parameters of the model of an estimate; None if that is not one of `MODELS`."""
    if estimate.model not in MODELS:
        if close := close_to(estimate.model, MODELS):
            raise damaged(f"there is no model {estimate.model!r}{close}")
        return None
    try:
        return {q.name: q for q in MODELS[estimate.model](**estimate.model_options).parameters}
    except (AttributeError, TypeError, ValueError) as error:
        raise damaged(f"options of model {estimate.model}: {error}") from None


def _check_value(estimate: Estimate, row: ParameterEstimate, q: Parameter) -> None:
    """Check unit and bounds of a value."""
    if row.unit != q.unit:
        raise damaged(f"{q.name} is in {row.unit!r}, and model {estimate.model} has it in {q.unit}")
    if q.positive:  # a logarithm, which is rounded
        lower, upper = (1.0 - 1e-9) * q.lower, (1.0 + 1e-9) * q.upper
    else:  # a regression keeps to no such bounds, so it may be outside by their distance
        lower, upper = 2.0 * q.lower - q.upper, 2.0 * q.upper - q.lower
    inside = lower <= row.value <= upper and abs(row.value) <= LARGEST
    unknown = math.isnan(row.value) and math.isnan(q.nominal) and not estimate.converged  # nothing was fitted
    if not inside and not unknown:
        bounds = f"[{max(q.lower, -LARGEST):g}, {min(q.upper, LARGEST):g}] {q.unit}"
        raise damaged(f"the value of {q.name} is {row.value:g}, and must be in {bounds}")


def _check_covariance(estimate: Estimate) -> None:
    known = np.isfinite([estimate[name].std_dev for name in estimate.free])
    if not np.isfinite(estimate.covariance[np.ix_(known, known)]).all():
        raise damaged("a number of its covariance is missing")
    for name, variance in zip(estimate.free, np.diag(estimate.covariance).tolist(), strict=True):
        # 0 is that of a parameter that is held at its bound, or that no recording shows
        if variance < 0.0 or (variance == 0.0 and estimate[name].verdict is Verdict.ESTIMATED):
            raise damaged(f"the variance of {name} is {variance:g} in its covariance")
