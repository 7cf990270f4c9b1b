"""What a regression says of the parameters, and whether its equations are those of the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from joint_id_core.estimators.regression.changed_gain import changed_gain
from joint_id_core.estimators.regression.covariance import autocorrelation
from joint_id_core.estimators.regression.encoder_lag import Lag
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.estimators.regression.fitted import Fitted, percent
from joint_id_core.estimators.regression.lag import drive_shift
from joint_id_core.estimators.regression.least_squares import (
    Solution,
    explained_later,
)
from joint_id_core.estimators.regression.missing import (
    GRAVITY,
    STRIBECK,
    STUCK,
    at_speed,
    share_explained,
    share_predicted,
)
from joint_id_core.estimators.regression.samples import Samples
from joint_id_core.estimators.regression.share import Share
from joint_id_core.estimators.shared.intervals import interval_text
from joint_id_core.estimators.shared.sentences import listed, not_shown, of_halves, sentence
from joint_id_core.models import Model
from joint_id_core.results.estimate import ParameterEstimate, Status
from joint_id_core.results.verdict import MAGNITUDE, Verdict


def tested(
    samples: Samples, solution: Solution, positive: Sequence[bool], motion: Motion, band_hz: float,
    share: Share | None, encoders: Lag | None = None, gear: Sequence[bool] = (),
) -> Fitted:  # fmt: skip
    """Return a solution with what tells whether its equation is that of the motion; `share`, `gear` as in `Fitted`."""
    y, columns, rows = samples.y, samples.columns, samples.rows
    fast, loose = samples.fast, at_speed(motion, rows.index, STUCK)
    tools = None if samples.tools is None else samples.tools.part(fast)
    static, pieces = samples.equation.static, rows.pieces[fast]
    later = explained_later(y[fast], columns[fast], positive, static, pieces, tools)
    memory = autocorrelation(y - columns @ solution.values, max(1, round(1.0 / (band_hz * samples.step))))
    gravity, helps = 0.0, {}
    for advice, more in samples.lacked.items():
        kept = loose if advice == STRIBECK else fast
        helps[advice] = share_predicted(y[kept], columns[kept], more[kept])
        if advice == GRAVITY:
            gravity = share_explained(y[fast], columns[fast], more[fast])
    at = samples.time[rows.index[fast]]
    late = drive_shift(samples.time, samples.drive, at, y[fast], columns[fast], band_hz)
    if late is not None and samples.turns_rather_than(late.explained):
        late = drive_shift(samples.time, samples.drive, at, y[fast], samples.with_turn[fast], band_hz)
    return Fitted(
        samples, solution, gravity, later, memory, helps, late, share, encoders, np.array(positive, bool),
        np.array(gear, bool),
    )  # fmt: skip


def estimates(model: Model, fitted: Fitted, starts: Mapping[str, float]) -> dict[str, ParameterEstimate]:
    """Return the parameters of an equation by name, and last the lag between the encoders if it is one of them."""
    found = {n: row(model, n, fitted, j, starts[n]) for j, n in enumerate(fitted.names)}
    encoders = fitted.encoders
    if encoders is not None and encoders.name is not None:
        q, late, sigma = model.parameter(encoders.name), encoders.late, encoders.sigma
        said = interval_text(late, sigma)
        found[q.name] = ParameterEstimate(q.name, q.unit, late, sigma, Verdict.ESTIMATED, starts[q.name], said)
    return found


def row(model: Model, name: str, fitted: Fitted, j: int, start: float) -> ParameterEstimate:
    """Return value, standard deviation and verdict of a parameter."""
    solution = fitted.solution
    q, value, sigma = model.parameter(name), float(solution.values[j]), float(np.sqrt(solution.covariance[j, j]))
    if solution.unseen[j]:
        verdict, reason = Verdict.NOT_EXCITED, "this motion does not show it, or only together with others"
        value, sigma = start, float("nan")
        if fitted.samples.tools is not None:
            value, reason = 0.0, f"{reason}: taken as 0"
    elif fitted.blind:
        said = interval_text(value, sigma)
        verdict, reason = Verdict.NOT_EXCITED, f"together with that of the link, as the motor feels it: {said}"
        value, sigma = start, float("nan")
    elif solution.below[j]:
        pulled = f"{solution.unbounded[j]:.3g} ± {solution.wide[j]:.2g} {q.unit}"
        verdict, reason = Verdict.AT_BOUND, f"the data pull it below 0, to {pulled}"
    elif solution.held[j] or (q.positive and sigma > MAGNITUDE * value):
        sigma = float(solution.wide[j]) if solution.held[j] else sigma
        verdict, reason = Verdict.PRIOR, f"it lies below about {value + 2.0 * sigma:.2g} {q.unit}, more is not known"
    else:
        verdict, reason = Verdict.ESTIMATED, interval_text(value, sigma)
    return ParameterEstimate(name, q.unit, value, sigma, verdict, start, reason)


def judge(
    model: Model,
    fitted: list[Fitted],
    found: Mapping[str, ParameterEstimate],
    held: tuple[str, ...],
    band_hz: float,
    dropped: int,
) -> tuple[Status, tuple[str, ...]]:
    """Return the status, and the findings as sentences, the most useful first.

    `held` parameters are in no equation; `dropped` samples lack an input.
    """
    worst = min(fitted, key=lambda f: f.solution.r_squared)
    below = [n for n, found_row in found.items() if found_row.verdict is Verdict.AT_BOUND]
    unseen = [n for n, found_row in found.items() if found_row.verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR)]
    quantity = worst.samples.equation.quantity
    explained = f"{percent(worst.solution.r_squared)} of the {quantity} below {band_hz:.3g} Hz are explained"
    if np.isfinite(worst.held_out.share):
        explained += (
            f"; a fit of the first part explains {percent(worst.held_out.share)} of friction and inertia in the rest"
        )
    faults = [fault for f in fitted if (fault := f.fault or changed_gain(f.samples))]
    of_joint = [found_row for n, found_row in found.items() if not model.parameter(n).of_recording]
    if faults:
        status, said = Status.POOR_FIT, [faults[0], Status.POOR_FIT.advice, explained]
    elif not any(found_row.verdict is Verdict.ESTIMATED for found_row in of_joint):
        status, said = Status.UNINFORMATIVE, [Status.UNINFORMATIVE.advice, explained]
    else:
        status, said = Status.CONVERGED, [Status.CONVERGED.advice, explained]
    if below:
        said.append(f"the data pull {listed(below)} below zero: the model does not describe all of the motion")
    if unseen and status is not Status.UNINFORMATIVE:
        said.append(not_shown(unseen))
    said += [f.lag for f in fitted if f.lag]
    said += [reason for f in fitted for reason in f.reasons]
    if changed := [change for f in fitted for change in f.changed]:
        said.insert(1, of_halves(changed))
    if held:
        said.append(f"held, because a regression cannot tell them: {listed(held)}")
    if dropped:
        said.append(f"{dropped} samples without an input were left out")
    return status, tuple(sentence(text) for text in said)
