"""Values of a regression in an estimate of innovations, where the residuals are not white and the two agree.

Where a model lacks something, the likelihood of innovations is a wrong one: its values scatter more than they need, and
its standard deviations had to be widened for that. The covariance of a regression reckons with a residual torque that
has a memory. Both have seen the same motion, so their mean would be no better than one of them; how far they are apart
tells what the model may lack (Hausman, Econometrica 46, 1978), and is in the interval.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from joint_id_core.estimators.opinion import Opinion
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.intervals import interval_text
from joint_id_core.estimators.shared.sentences import listed, message, sentence, without_shown
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.results.verdict import MAGNITUDE, Verdict

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
    rows, scale = {row.name: row for row in estimate.parameters}, np.ones(len(estimate.free))
    taken = []
    for second in opinion.seconds:
        first = rows[second.name]
        sigma = math.hypot(second.wide, second.value - first.value, LEAST * second.value)
        if f"by {Regression.name}" in first.reason:  # both values are in it already
            continue
        positive = model.parameter(second.name).positive
        if not sigma < NARROWER * first.std_dev or (positive and sigma > MAGNITUDE * second.value):
            continue
        scale[estimate.free.index(second.name)] = sigma / first.std_dev
        row = replace(first, verdict=Verdict.ESTIMATED, reason=interval_text(second.value, sigma))
        rows[second.name] = replace(row, value=second.value, std_dev=sigma)
        taken.append(second.name)
    if not taken:
        return estimate
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
