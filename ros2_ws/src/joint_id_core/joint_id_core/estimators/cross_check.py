"""A fit of one estimator checked by another one, which makes other assumptions.

`innovations` takes what the model lacks for white noise of the torque. On a real robot it has a memory, and the
controller reacts to it, so it goes with the motion; then inertia gets too large by many standard deviations, and the
residuals do not show it. The inverse dynamics of `regression` do not depend on the colour of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.data.quantities import with_deviation
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.opinion import Opinion, Second, second_opinion
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.intervals import between, interval_text, widened
from joint_id_core.estimators.shared.mean_drive import CHANGES
from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Status
from joint_id_core.results.verdict import Verdict

APART = 3.0  # standard deviations from which two values disagree: with six parameters, 2 would be too few
EXPLAINED = 1.5  # the same up to which noise of a sensor may be all of it
FURTHER = 2.0  # the same from which an interval contains both
CAUSE = (
    "the torque has a part that the model lacks and that goes with the motion (a load of other joints, friction with a "
    "memory), or its samples are late"
)
# What the equations lack between two samples, where friction reverses, moves values by a few percent.
DOUBTED = 0.01  # least doubt of a regression, over the value, that is taken; below it, chance in a correct model
MATTERS = 0.1  # least difference of a positive parameter, over its value, that counts as one
MATTERS_TORQUE = 0.05  # the same of other parameters: the torque that it makes, over the rms torque


def cross_checked(
    estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings | None = None
) -> Estimate:
    """Return an estimate with what a regression of the same recording says of it: see `judged`."""
    opinion = second_opinion(estimate, model, recording, settings)
    return estimate if opinion is None else judged(estimate, model, opinion)


def judged_whole(estimate: Estimate, model: Model, opinion: Opinion) -> Estimate:
    """Return the same for a whole recording, in which the joint must not change: live, that is what is looked for."""
    found = judged(estimate, model, opinion)
    return _poor(found, opinion.changed) if opinion.changed and not opinion.fault else found


def judged(estimate: Estimate, model: Model, opinion: Opinion) -> Estimate:
    """Return an estimate with a second opinion.

    Where the two values of a parameter differ by more than their intervals, the value becomes the middle, the interval
    contains both, and the status is DISAGREE. Where the residual torque has a memory, standard deviations, which take
    it for white, become at least those of the regression. So they do where the drive is late or early, or changes
    between two samples, which is noted. If the equations of motion do not explain the torque, the status is POOR_FIT.
    A poor fit is told what the regression says of the motion.
    """
    estimate = _without_useless_advice(estimate, opinion)
    if opinion.lag:
        notes = (*estimate.notes[:1], sentence(opinion.lag), *estimate.notes[1:])
        estimate = estimate.noted(notes)
    if opinion.between and not any(CHANGES in note for note in estimate.notes):
        notes = (*estimate.notes[:1], sentence(opinion.between), *estimate.notes[1:])
        estimate = estimate.noted(notes)
    if estimate.status is Status.POOR_FIT and not opinion.fault and not opinion.lag:
        return _with_advice(estimate, opinion)
    if estimate.status is Status.POOR_FIT and opinion.fault:
        notes = (*estimate.notes[:1], sentence(opinion.fault), *estimate.notes[1:])
        return estimate.noted(notes)
    if not estimate.converged:
        return estimate
    if opinion.fault:
        return _poor(estimate, opinion.fault)
    # What the drive does between samples may be off by less than what matters, and be known: all differences count.
    apart = [second for second in opinion.seconds if _disagrees(estimate, model, second, bool(opinion.between))]
    if apart:
        return _widened(estimate, model, opinion, apart)
    wide = opinion.coloured or opinion.between or opinion.lag
    known = opinion.seconds if wide else [s for s in opinion.seconds if _in_doubt(estimate[s.name], s)]
    found = _as_wide(estimate, model, opinion, known) if known else estimate
    return _containing(found, model, opinion)


def _containing(estimate: Estimate, model: Model, opinion: Opinion) -> Estimate:
    """Return an estimate whose intervals contain second values that are further away than chance, but do not disagree.

    Both estimators have seen the same motion, so chance moves their values together.
    """
    rows, scale, further = {row.name: row for row in estimate.parameters}, np.ones(len(estimate.free)), list[str]()
    for second in opinion.seconds:
        first = rows[second.name]
        distance = abs(first.value - second.value)
        if _claims(first, model) and distance > FURTHER * math.hypot(first.std_dev, second.sigma):
            sigma = math.hypot(first.std_dev, distance)
            scale[estimate.free.index(second.name)] = sigma / first.std_dev
            rows[second.name] = widened(model, first, sigma)
            further.append(second.name)
    if not further:
        return estimate
    said = f"the intervals of {listed(further)} contain the values of a regression, which are further away than chance"
    return _with_rows(estimate, rows, scale, (*estimate.notes[:1], sentence(said), *estimate.notes[1:]))


def _in_doubt(row: ParameterEstimate, second: Second) -> bool:
    """Return whether a regression doubts a value by more than its standard deviation, and by what matters."""
    return second.doubt > max(row.std_dev, DOUBTED * abs(row.value))


def _claims(row: ParameterEstimate, model: Model) -> bool:
    """Return whether the interval of a parameter says something: a bound of its magnitude does, too."""
    bound = row.verdict is Verdict.PRIOR and model.parameter(row.name).positive
    return bound or row.verdict is Verdict.ESTIMATED


def _without_noise(estimate: Estimate, name: str) -> float:
    """Return a standard deviation without what noise of the drive's sensor may do."""
    sigma, checks = estimate[name].std_dev, estimate.checks
    if checks is None or checks.of_drive is None:
        return sigma
    return math.sqrt(max(sigma**2 - float(checks.of_drive[estimate.free.index(name)]) ** 2, 0.0))


def _disagrees(estimate: Estimate, model: Model, second: Second, any_size: bool) -> bool:
    """Return whether two values differ by more than chance, and by an amount that matters unless `any_size` does.

    Noise of the drive's sensor moves one estimator and not the other, by one of the deviations that contain it.
    Beyond `EXPLAINED` of them something else is there, and the difference counts as if there were no noise.
    """
    first = estimate[second.name]
    apart = abs(first.value - second.value)
    if first.verdict is not Verdict.ESTIMATED or apart < EXPLAINED * math.hypot(first.std_dev, second.sigma):
        return False
    sigma = _without_noise(estimate, second.name)
    if model.parameter(second.name).positive:  # estimated as a logarithm
        matters = any_size or apart > MATTERS * max(first.value, second.value)
        factor = math.exp(APART * sigma / first.value)
        reach = first.value * (factor - 1.0 if second.value > first.value else 1.0 - 1.0 / factor)
    else:
        matters, reach = any_size or apart * second.torque > MATTERS_TORQUE, APART * sigma
    return matters and apart > math.hypot(reach, APART * second.sigma)


def _without_useless_advice(estimate: Estimate, opinion: Opinion) -> Estimate:
    """Return an estimate without the advice to add torques with which new samples are predicted no better."""
    notes = list(estimate.notes)
    for advice in opinion.useless:
        notes = [note.replace(f": try {advice})", f"; {advice} would predict new samples no better)") for note in notes]
    if notes == [*estimate.notes]:
        return estimate
    return estimate.noted(notes)


def _with_advice(estimate: Estimate, opinion: Opinion) -> Estimate:
    """Return a poor fit with the advice to use the regression, which describes the motion."""
    advice = f"inverse dynamics explain {100.0 * opinion.r_squared:.3g} % of the torque: take --estimator regression"
    first, *others = estimate.notes
    better = [note for note in others if ": try --" in note]  # what is still advised would help
    notes = (first, *better, sentence(advice), *(note for note in others if note not in better))
    return estimate.noted(notes)


def _poor(estimate: Estimate, fault: str) -> Estimate:
    notes = (sentence(fault), sentence(Status.POOR_FIT.advice), *estimate.notes[1:])
    return estimate.noted(notes, status=Status.POOR_FIT)


def _widened(estimate: Estimate, model: Model, opinion: Opinion, apart: Sequence[Second]) -> Estimate:
    """Return an estimate between the two values of the parameters `apart`, whose intervals contain both.

    The others keep their values. What is wrong with one parameter is wrong with them as well, by less: the distance of
    their second values is added to their standard deviations.
    """
    rows, scale = {row.name: row for row in estimate.parameters}, np.ones(len(estimate.free))
    told = []
    for second in opinion.seconds:
        first = rows[second.name]
        distance = abs(first.value - second.value)
        if second in apart:
            values = (
                f"{with_deviation(first.value, first.std_dev)} by {estimate.estimator}, "
                f"{with_deviation(second.value, second.wide)} by {Regression.name}"
            )
            found = between(model, first, (second.value, second.wide), values)
            told.append(f"{second.name} is {found.reason}")
        else:
            sigma = math.hypot(first.std_dev, distance)
            if opinion.lag:  # which moves both values the same way
                sigma = max(sigma, second.wide)
            found = replace(first, std_dev=sigma, reason=interval_text(first.value, sigma))
        scale[estimate.free.index(second.name)] = found.std_dev / first.std_dev
        rows[second.name] = found
    cause = opinion.lag or f"most likely {CAUSE}"
    said = [f"{'; '.join(told)}: the value lies between, and the interval contains both", cause]
    others = [note for note in estimate.notes[1:] if note != sentence(cause)]
    notes = (*map(sentence, said), sentence(Status.DISAGREE.advice), *others)
    return replace(_with_rows(estimate, rows, scale, notes), status=Status.DISAGREE)


def _with_rows(
    estimate: Estimate, rows: Mapping[str, ParameterEstimate], scale: Array, notes: tuple[str, ...]
) -> Estimate:  # fmt: skip
    """Return an estimate with other rows and notes, whose standard deviations grow by `scale` (free,)."""
    covariance = estimate.covariance * np.outer(scale, scale)
    return estimate.noted(notes, parameters=tuple(rows.values()), covariance=covariance)


def _as_wide(estimate: Estimate, model: Model, opinion: Opinion, seconds: Sequence[Second]) -> Estimate:
    """Return an estimate whose intervals are at least as wide as those of the regression.

    They know of the memory of the residual torque, and of torques that the model lacks.
    """
    rows, scale = {row.name: row for row in estimate.parameters}, np.ones(len(estimate.free))
    wider = []
    for name in opinion.unseen:
        if rows[name].verdict is Verdict.ESTIMATED:
            said = "a regression, which knows the memory of the residual torque, does not find it in this motion"
            rows[name] = replace(rows[name], verdict=Verdict.PRIOR, reason=said)
    for second in seconds:
        first = rows[second.name]
        if not _claims(first, model) or not second.wide > first.std_dev:
            continue
        scale[estimate.free.index(second.name)] = second.wide / first.std_dev
        rows[second.name] = widened(model, first, second.wide)
        wider.append(second.name)
    if not wider:
        return replace(estimate, parameters=tuple(rows.values()))
    why = "what the drive does between samples is not known"
    if opinion.lag:
        why = "the drive is late or early"
    elif opinion.coloured:
        why = "the residual torque has a memory"
    elif not opinion.between:
        why = "the residual torque may hold one that the model lacks"
    said = f"{why}: the intervals of {listed(wider)} are those of a regression, which depend on it less"
    place = 2 if opinion.lag else 1  # after the sentence that tells by how much
    if not (opinion.lag or opinion.coloured or opinion.between):
        place = len(estimate.notes)  # what the residuals show tells more
    return _with_rows(estimate, rows, scale, (*estimate.notes[:place], sentence(said), *estimate.notes[place:]))
