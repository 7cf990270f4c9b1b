"""Fit of a model by inverse-dynamics regression."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import side_of
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.checks import EXPLAINED, gravity, share_explained
from joint_id_core.estimators.regression.equations import Equation, equations, not_linear
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.least_squares import Solution, solve
from joint_id_core.estimators.regression.signals import Rows, band, motion, rows, smoothed
from joint_id_core.estimators.shared.fit_data import (
    MIN_SAMPLES,
    FitData,
    UnusableError,
    options_of,
    origin_of,
    prepare,
    unusable,
)
from joint_id_core.estimators.shared.sentences import listed, message, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Predictions, Status, Verdict

LEAST_R_SQUARED = 0.5  # below, the equation is not that of this motion
KNOWN = 0.5  # standard deviation over the value above which a value is known by its order of magnitude at best


@dataclass(frozen=True)
class Fitted:
    """An equation, its samples in the band, and the solution.

    `gravity` is the share of what it leaves unexplained that gravity would explain, if the model has none.
    """

    equation: Equation
    rows: Rows
    y: Array
    columns: Array
    solution: Solution
    gravity: float


def fit_regression(
    model: Model, recording: Recording, settings: ParameterSettings | None = None, options: Regression | None = None
) -> Estimate:
    """Fit a model to a recording: see `estimators.fit`.

    Raises:
        JointIdError: misuse of names or values, priors, a model that a regression does not suit. Poor data come back
            as an `Estimate` with a status.
    """
    begun, options = time.perf_counter(), options or Regression()
    _suits(model)
    if settings is not None and settings.priors:
        raise JointIdError("estimator regression takes no priors: leave them out, or use the estimator innovations")
    try:
        data = prepare(model, recording, settings, leave_out_rests=True)
        band_hz = options.band_hz or band(data)
        fitted = _fitted(data, band_hz, options.lag_s)
    except UnusableError as error:
        return unusable(model, Regression.name, error, recording)
    return _estimate(data, fitted, band_hz, begun)


def _suits(model: Model) -> None:
    """Check that noise of sensors does not bias a regression of this model.

    Raises:
        JointIdError: the model has a drive that is no torque or current, or motion on both sides of the gear.
    """
    sides = {side_of(n) for n in (*model.state_names, *model.input_names)} - {None}
    if model.torque_drive is None or len(sides) != 1:
        raise JointIdError(
            f"estimator regression does not suit model {model.name}: noise of the current, or of the twist of the "
            "gear, would bias it. Use the estimator innovations, or model rigid_joint"
        )


def _fitted(data: FitData, band_hz: float, lag_s: float) -> list[Fitted]:
    """Fit every equation of the model that holds free parameters."""
    model = data.model
    values = dict(zip(model.parameter_names, data.p.tolist(), strict=True))
    moved = motion(data)
    usable = np.all([np.isfinite(v) for part in (moved.x, moved.u, moved.rates) for v in part.values()], axis=0)
    index = rows(data, usable, band_hz)
    if len(index.index) < MIN_SAMPLES:
        raise UnusableError(
            Status.TOO_SHORT,
            f"{data.recording.source}: {len(index.index)} independent samples of motion below {band_hz:.3g} Hz, a "
            f"regression needs {MIN_SAMPLES}: record longer, or give a wider band (band_hz)",
        )
    found, angle = [], moved.x.get("link_position")
    for equation in equations(model, moved, values, data.free):
        load = np.zeros((len(usable), 0)) if model.has_gravity or angle is None else gravity(angle)
        table, last = np.column_stack([equation.y, equation.columns, load]), 1 + len(equation.names)
        table[~usable] = np.nan
        table = smoothed(data.recording.time, table, band_hz)[index.index]
        known = np.isfinite(table).all(axis=1)
        here, table = Rows(index.index[known], index.pieces[known]), table[known]
        step = float(np.median(np.diff(data.recording.time[here.index]))) if len(here.index) > 1 else data.period
        positive = [model.parameter(n).positive for n in equation.names]
        y, columns = table[:, 0], table[:, 1:last]
        solution = solve(y, columns, positive, here.pieces, lag_s / step)
        found.append(Fitted(equation, here, y, columns, solution, share_explained(y, columns, table[:, last:])))
    if not found:
        raise UnusableError(
            Status.MISSING_SIGNAL,
            f"{data.recording.source}: no equation of {model.name} is linear in {listed(data.free)}: use the estimator "
            "innovations",
        )
    return found


def _estimate(data: FitData, fitted: list[Fitted], band_hz: float, begun: float) -> Estimate:
    """Return the estimate."""
    model, held = data.model, not_linear(data.model, [f.equation for f in fitted], data.free)
    free = tuple(n for f in fitted for n in f.equation.names)
    order = [free.index(n) for n in data.free if n in free]
    covariance = np.zeros((len(free), len(free)))
    at, found = 0, dict[str, ParameterEstimate]()
    for f in fitted:
        k = len(f.equation.names)
        covariance[at : at + k, at : at + k] = np.nan_to_num(f.solution.covariance, nan=0.0)
        at += k
        for j, name in enumerate(f.equation.names):
            found[name] = _row(model, name, f.solution, j, float(data.p[model.parameter_names.index(name)]))
    rows_ = tuple(
        found.get(q.name, ParameterEstimate(q.name, q.unit, v, np.nan, Verdict.FIXED, v, "held at this value"))
        for q, v in zip(model.parameters, data.p.tolist(), strict=True)
    )
    status, notes = _judge(data, fitted, found, held, band_hz)
    nrmse, predictions = _predictions(data, fitted)
    seen = data.recording.time[fitted[0].rows.index]
    return Estimate(
        model=model.name, estimator=Regression.name, status=status, message=message(notes), parameters=rows_,
        free=tuple(free[i] for i in order), covariance=covariance[np.ix_(order, order)], nrmse=nrmse,
        observations=sum(len(f.y) for f in fitted), elapsed_s=time.perf_counter() - begun, start=float(seen[0]),
        end=float(seen[-1]), samples=sum(len(f.y) for f in fitted), predictions=predictions, notes=notes,
        model_options=options_of(model), **origin_of(data.recording),
    )  # fmt: skip


def _row(model: Model, name: str, solution: Solution, j: int, start: float) -> ParameterEstimate:
    """Return value, standard deviation and verdict of a parameter."""
    q, value, sigma = model.parameter(name), float(solution.values[j]), float(np.sqrt(solution.covariance[j, j]))
    if solution.unseen[j]:
        verdict, reason = Verdict.NOT_EXCITED, "this motion does not show it, or only together with others"
        value, sigma = start, float("nan")
    elif solution.held[j]:
        verdict, reason = Verdict.AT_BOUND, f"the data pull it below 0 {q.unit}"
    elif q.positive and sigma > KNOWN * value:
        verdict, reason = Verdict.PRIOR, f"it lies below about {value + 2.0 * sigma:.2g} {q.unit}, more is not known"
    else:
        verdict, reason = Verdict.ESTIMATED, f"95 % interval {value - 1.96 * sigma:.4g} to {value + 1.96 * sigma:.4g}"
    return ParameterEstimate(name, q.unit, value, sigma, verdict, start, reason)


def _judge(
    data: FitData, fitted: list[Fitted], found: dict[str, ParameterEstimate], held: tuple[str, ...], band_hz: float
) -> tuple[Status, tuple[str, ...]]:
    """Return the status, and the findings as sentences, the most useful first."""
    worst = min(fitted, key=lambda f: f.solution.r_squared)
    r_squared = worst.solution.r_squared
    bounds = [n for n, row in found.items() if row.verdict is Verdict.AT_BOUND]
    explained = f"{100.0 * r_squared:.3g} % of the torque below {band_hz:.3g} Hz are explained"
    if not r_squared > LEAST_R_SQUARED:
        status, said = Status.POOR_FIT, [f"only {explained}", Status.POOR_FIT.advice]
    elif worst.gravity > EXPLAINED:
        load = f"a load that depends on the angle explains {100.0 * worst.gravity:.2g} % of what is left"
        status, said = Status.POOR_FIT, [f"{load}: take a model with gravity (--gravity)", explained]
    elif not any(row.verdict is Verdict.ESTIMATED for row in found.values()):
        status, said = Status.POOR_FIT, ["this motion shows none of the parameters: move faster or for longer"]
    else:
        status, said = Status.CONVERGED, [Status.CONVERGED.advice, explained]
    unseen = [n for n, row in found.items() if row.verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR)]
    said += (
        [f"the data pull {listed(bounds)} below zero: the model does not describe all of the motion"] if bounds else []
    )
    said += [f"this motion does not show {listed(unseen)}"] if unseen else []
    said += [f"held, because the equations are not linear in them: {listed(held)}"] if held else []
    said += [f"{data.dropped} samples without an input were left out"] if data.dropped else []
    return status, tuple(sentence(text) for text in said)


def _predictions(data: FitData, fitted: list[Fitted]) -> tuple[dict[str, float], Predictions]:
    """Return rms error over standard deviation, and measurement and prediction, of the drive in the band."""
    drive, f = data.model.torque_drive, next(f for f in fitted if f.equation.factor)
    assert drive is not None
    measured, predicted = f.y / f.equation.factor, f.columns @ f.solution.values / f.equation.factor
    time_, nrmse = data.recording.time[f.rows.index], float(np.sqrt(max(0.0, 1.0 - f.solution.r_squared)))
    return {drive: nrmse}, Predictions(time_, {drive: measured}, {drive: predicted})
