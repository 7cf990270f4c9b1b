"""Values of a regression in an estimate of innovations, where the residuals are not white and the two agree.

Where a model lacks something, the likelihood of innovations is a wrong one: its values scatter more than they need, and
its standard deviations had to be widened for that. The covariance of a regression reckons with a residual torque that
has a memory. Both have seen the same motion, so their mean would be no better than one of them; how far they are apart
tells what the model may lack (Hausman, Econometrica 46, 1978), and is in the interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.estimators.opinion import Opinion, Second
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.intervals import interval_text
from joint_id_core.estimators.shared.sentences import listed, message, sentence, without_shown
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import MAGNITUDE, STRONG_CORRELATION, Verdict

# Least standard deviation over the value: what both have in common (an eccentric encoder: 0.3 % of J) neither shows.
LEAST = 0.01
NARROWER = 0.8  # times the standard deviation before: else a value stays


def narrowed(estimate: Estimate, model: Model, opinion: Opinion) -> Estimate:
    """Return an estimate with those values of a regression that are known better, distances included.

    It converged, or the two disagree on other parameters. One that is corrected for what it lacks stays (`correction`):
    a regression does not know of that.
    """
    checks = estimate.checks
    if estimate.status not in (Status.CONVERGED, Status.DISAGREE) or checks is None or checks.bias is not None:
        return estimate
    if estimate.converged and not opinion.coloured and not any(checks.texts):
        return estimate
    better = {
        second.name: (second.value, sigma)
        for second in opinion.seconds
        if (sigma := _sigma(estimate[second.name], second, model)) < NARROWER * estimate[second.name].std_dev
    }
    taken = _by_themselves(estimate, list(better))
    if not taken:
        return estimate
    rows, scale = {row.name: row for row in estimate.parameters}, np.ones(len(estimate.free))
    for name in taken:
        (value, sigma), first = better[name], rows[name]
        scale[estimate.free.index(name)] = sigma / first.std_dev
        row = replace(first, verdict=Verdict.ESTIMATED, reason=interval_text(value, sigma))
        rows[name] = replace(row, value=value, std_dev=sigma)
    said = (
        f"the values of {listed(taken)} are those of a {Regression.name}, which depend less on what the residuals "
        f"show, and the intervals contain those of {estimate.estimator}"
    )
    notes, place = without_shown(estimate.notes, taken), 1 if estimate.converged else 2  # after the likely cause
    notes = (*notes[:place], sentence(said), *notes[place:])
    covariance = estimate.covariance * np.outer(scale, scale)
    return replace(
        estimate, message=message(notes), notes=notes, parameters=tuple(rows.values()), covariance=covariance
    )  # fmt: skip


def _sigma(first: ParameterEstimate, second: Second, model: Model) -> float:
    """Return the standard deviation of a second value that contains its distance to the first; inf if it stays out.

    It does if it tells little more than a size, or that the parameter is about zero.
    """
    sigma = math.hypot(second.wide, second.value - first.value, LEAST * second.value)
    size = second.value if model.parameter(second.name).positive else abs(second.value)
    both = f"by {Regression.name}" in first.reason  # they disagree: both values are in its interval already
    return math.inf if sigma > MAGNITUDE * size or both else sigma


def _by_themselves(estimate: Estimate, names: Sequence[str]) -> list[str]:
    """Return names without those that are strongly correlated with others: of such, all are taken or none."""
    sigma = np.sqrt(np.diag(estimate.covariance))
    tied = np.abs(estimate.covariance) > STRONG_CORRELATION * np.outer(sigma, sigma)
    taken = np.isin(estimate.free, names)
    while (lost := taken & (tied & ~taken).any(axis=1)).any():
        taken &= ~lost
    return [name for name in names if taken[estimate.free.index(name)]]
