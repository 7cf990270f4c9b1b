"""Intervals of innovations from a regression, where the residuals are not white and the two agree.

Where a model lacks something, the likelihood of innovations is a wrong one, and its standard deviations had to be
widened for that. The covariance of a regression reckons with a residual torque that has a memory. Both have seen the
same motion; how far they are apart tells what the model may lack (Hausman, Econometrica 46, 1978). So what is certain
of a parameter is what the regression knows of it, and that distance. The values stay, since they belong together.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from joint_id_core.estimators.opinion import Opinion, Second
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.intervals import interval_text
from joint_id_core.estimators.shared.sentences import listed, sentence, without_shown
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import MAGNITUDE, Verdict

# Least standard deviation over the value: what both have in common (an eccentric encoder: 0.3 % of J) neither shows.
LEAST = 0.01
NARROWER = 0.8  # times the standard deviation before: else it stays


def narrowed(estimate: Estimate, model: Model, opinion: Opinion) -> Estimate:
    """Return an estimate with the intervals of a regression, distances included, where these are narrower.

    It converged, or the two disagree on other parameters. One that is corrected for what it lacks stays (`correction`):
    a regression does not know of that. Nor does it know what a parameter adds that it holds, as a torque constant. A
    recorded drive whose gain changes is that of both: what it does stays in the intervals.
    """
    checks = estimate.checks
    if estimate.status not in (Status.CONVERGED, Status.DISAGREE) or checks is None or checks.bias is not None:
        return estimate
    if opinion.holds:
        return estimate
    if estimate.converged and not opinion.coloured and not any(checks.texts):
        return estimate
    rows, scale = {row.name: row for row in estimate.parameters}, np.ones(len(estimate.free))
    of_gain = dict(zip(estimate.free, np.zeros(len(scale)) if checks.of_gain is None else checks.of_gain, strict=True))
    taken = []
    for second in opinion.seconds:
        first = rows[second.name]
        if (sigma := _sigma(first, second, of_gain[second.name], model)) < NARROWER * first.std_dev:
            scale[estimate.free.index(second.name)] = sigma / first.std_dev
            reason = interval_text(first.value, sigma)
            rows[second.name] = replace(first, std_dev=sigma, verdict=Verdict.ESTIMATED, reason=reason)
            taken.append(second.name)
    if not taken:
        return estimate
    said = (
        f"the intervals of {listed(taken)} are those of a {Regression.name}, which depend less on what the residuals "
        f"show, and contain its values"
    )
    notes, place = without_shown(estimate.notes, taken), 1 if estimate.converged else 2  # after the likely cause
    notes = (*notes[:place], sentence(said), *notes[place:])
    covariance = estimate.covariance * np.outer(scale, scale)
    return estimate.noted(notes, parameters=tuple(rows.values()), covariance=covariance)


def _sigma(first: ParameterEstimate, second: Second, shared: float, model: Model) -> float:
    """Return the standard deviation of a value that contains a second one; inf if it says little.

    That is little more than a size, or that the parameter is about zero. Both have a `shared` standard deviation.
    """
    sigma = math.hypot(second.wide, second.value - first.value, LEAST * first.value, shared)
    size = first.value if model.parameter(second.name).positive else abs(first.value)
    both = f"by {Regression.name}" in first.reason  # they disagree: both values are in its interval already
    return math.inf if sigma > MAGNITUDE * size or both else sigma
