"""A fit of one estimator checked by another one, which makes other assumptions.

`innovations` takes what the model lacks for white noise of the torque. On a real robot it has a memory, and the
controller reacts to it, so it goes with the motion; then inertia gets too large by many standard deviations, and the
residuals do not show it. The inverse dynamics of `regression` do not depend on the colour of the noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status, Verdict

if TYPE_CHECKING:  # SciPy loads with it
    from joint_id_core.estimators.regression.judging import Fitted

WIDTH = 1.96  # of a 95 % interval, in standard deviations
APART = 3.0  # standard deviations from which two values disagree: with six parameters, 2 would be too few
CAUSE = (
    "the torque has a part that the model lacks and that goes with the motion (a load of other joints, friction with a "
    "memory), or its samples are late"
)
# What the equations lack between two samples, where friction reverses, moves values by a few percent.
MATTERS = 0.1  # least difference of a positive parameter, over its value, that counts as one
MATTERS_TORQUE = 0.05  # the same of other parameters: the torque that it makes, over the rms torque
KNOWN = 0.5  # standard deviation over a positive value from which only its order of magnitude is known


@dataclass(frozen=True)
class _Second:
    """Value and standard deviation of a parameter by the second estimator.

    `torque` is what one unit of the parameter makes, over the rms torque.
    """

    name: str
    value: float
    sigma: float
    torque: float


def cross_checked(
    estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings | None = None
) -> Estimate:
    """Return an estimate with what a regression of the same recording says of it.

    An estimate of a model that a regression does not suit is returned as it is. So is one that did not converge, with a
    note if the regression describes the motion. A drive that is late or early against the motion is noted.

    Where the two values of a parameter differ by more than their intervals, the standard deviation is widened so
    that the interval contains both, and the status is DISAGREE. If the equations of motion do not explain the torque,
    it is POOR_FIT.
    """
    settings = settings or ParameterSettings()
    if estimate.status not in (Status.CONVERGED, Status.POOR_FIT, Status.MAX_ITERATIONS) or model.label_delays:
        return estimate
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    # What the user believes or scales himself is not checked.
    own = set(settings.fixed) | set(settings.freed) | set(settings.priors)
    held = [n for n in estimate.values if n not in estimate.free or n in own]
    if len(held) == len(estimate.values):
        return estimate
    try:
        fitted = regressed(model, recording, ParameterSettings(estimate.values, held), Regression())
    except JointIdError:
        return estimate
    lags = tuple(sentence(f.lag) for f in fitted if f.lag)
    if lags:
        notes = (*estimate.notes[:1], *lags, *estimate.notes[1:])
        estimate = replace(estimate, notes=notes, message=message(notes))
    faults = [f.fault for f in fitted if f.fault]
    if not estimate.converged:
        advise = estimate.status is Status.POOR_FIT and not faults and not lags
        return _with_advice(estimate, fitted) if advise else estimate
    if faults:
        return _poor(estimate, faults[0])
    apart = [second for f in fitted for second in _seconds(f) if _disagrees(estimate, model, second)]
    return _widened(estimate, apart) if apart else estimate


def _seconds(fitted: Fitted) -> list[_Second]:
    """Return what a regression knows of each parameter."""
    found, torque = fitted.solution, np.sqrt(np.mean(fitted.columns**2, axis=0) / np.mean(fitted.y**2))
    rows = zip(fitted.equation.names, found.unbounded.tolist(), found.sigma.tolist(), torque.tolist(), strict=True)
    return [_Second(*row) for row in rows if np.isfinite(row[2])]


def _disagrees(estimate: Estimate, model: Model, second: _Second) -> bool:
    """Return whether two values differ by an amount that matters and their intervals have nothing in common."""
    first = estimate[second.name]
    if first.verdict is not Verdict.ESTIMATED:
        return False
    apart = abs(first.value - second.value)
    if model.parameter(second.name).positive:  # estimated as a logarithm
        matters = apart > MATTERS * max(first.value, second.value)
        factor = math.exp(APART * first.std_dev / first.value)
        lowest, highest = first.value / factor, first.value * factor
    else:
        matters = apart * second.torque > MATTERS_TORQUE
        lowest, highest = first.value - APART * first.std_dev, first.value + APART * first.std_dev
    reach = APART * second.sigma
    return matters and (second.value + reach < lowest or second.value - reach > highest)


def _with_advice(estimate: Estimate, fitted: list[Fitted]) -> Estimate:
    """Return a poor fit with the advice to use the regression, which describes the motion."""
    worst = min(f.solution.r_squared for f in fitted)
    advice = f"inverse dynamics explain {100.0 * worst:.3g} % of the torque: take --estimator regression"
    notes = (*estimate.notes[:1], sentence(advice), *estimate.notes[1:])
    return replace(estimate, message=message(notes), notes=notes)


def _poor(estimate: Estimate, fault: str) -> Estimate:
    notes = (sentence(fault), sentence(Status.POOR_FIT.advice), *estimate.notes[1:])
    return replace(estimate, status=Status.POOR_FIT, message=message(notes), notes=notes)


def _widened(estimate: Estimate, apart: list[_Second]) -> Estimate:
    """Return an estimate whose intervals contain the second values, which are reported."""
    scale = np.ones(len(estimate.free))
    rows, told = list(estimate.parameters), []
    for second in apart:
        at = list(estimate.values).index(second.name)
        first = rows[at]
        sigma = abs(first.value - second.value) / WIDTH + second.sigma
        scale[estimate.free.index(second.name)] = sigma / first.std_dev
        values = (
            f"{second.name} is {first.value:.3g} ± {first.std_dev:.2g} by {estimate.estimator}, "
            f"{second.value:.3g} ± {second.sigma:.2g} by {Regression.name}"
        )
        told.append(values)
        verdict = first.verdict
        if verdict is Verdict.ESTIMATED and first.value > 0.0 and sigma > KNOWN * first.value:
            verdict = Verdict.PRIOR
        rows[at] = replace(first, std_dev=sigma, verdict=verdict, reason=f"{values}: the interval contains both")
    said = [f"{'; '.join(told)}: the intervals contain both values", f"most likely {CAUSE}"]
    notes = (*map(sentence, said), sentence(Status.DISAGREE.advice), *estimate.notes[1:])
    return replace(
        estimate, status=Status.DISAGREE, message=message(notes), notes=notes, parameters=tuple(rows),
        covariance=estimate.covariance * np.outer(scale, scale),
    )  # fmt: skip
