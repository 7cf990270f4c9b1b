"""Fit of a model by inverse-dynamics regression."""

from __future__ import annotations

import time

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import side_of
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.equations import equations, not_linear
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.judging import Fitted, Samples, judge, row, tested
from joint_id_core.estimators.regression.least_squares import solve
from joint_id_core.estimators.regression.missing import missing_torques
from joint_id_core.estimators.regression.signals import Rows, bands, motion, rows, smoothed
from joint_id_core.estimators.shared.fit_data import (
    MIN_SAMPLES,
    FitData,
    UnusableError,
    options_of,
    origin_of,
    prepare,
    unusable,
)
from joint_id_core.estimators.shared.sentences import listed, message
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Predictions, Status, Verdict


def fit_regression(
    model: Model, recording: Recording, settings: ParameterSettings | None = None, options: Regression | None = None
) -> Estimate:
    """Fit a model to a recording: see `estimators.fit`.

    Raises:
        JointIdError: misuse of names or values, priors, a model that a regression does not suit. Poor data come back
            as an `Estimate` with a status.
    """
    begun, options = time.perf_counter(), options or Regression()
    require_suitable(model)
    if settings is not None and settings.priors:
        raise JointIdError("estimator regression takes no priors: leave them out, or use the estimator innovations")
    try:
        data = prepare(model, recording, settings, leave_out_rests=True)
        band_hz, fitted = fitted_equations(data, options)
    except UnusableError as error:
        return unusable(model, Regression.name, error, recording)
    return _estimate(data, fitted, band_hz, begun)


def regressed(model: Model, recording: Recording, settings: ParameterSettings, options: Regression) -> list[Fitted]:
    """Return the fits of the equations of a model alone.

    Raises:
        JointIdError: as `fit_regression`.
        UnusableError: the recording cannot be used.
    """
    require_suitable(model)
    return fitted_equations(prepare(model, recording, settings, leave_out_rests=True), options)[1]


def require_suitable(model: Model) -> None:
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


def fitted_equations(data: FitData, options: Regression) -> tuple[float, list[Fitted]]:
    """Fit every equation of the model that holds free parameters; return the band in Hz, and the fits.

    Raises:
        UnusableError: too few samples, a state that is not measured, or no equation is linear.
    """
    found_bands = bands(data)
    model, band_hz, lag_s = data.model, options.band_hz or found_bands.equations, options.lag_s
    values = dict(zip(model.parameter_names, data.p.tolist(), strict=True))
    moved = motion(data, max(band_hz, found_bands.motion))
    usable = np.all([np.isfinite(v) for part in (moved.x, moved.u, moved.rates) for v in part.values()], axis=0)
    index = rows(data, usable, band_hz)
    if len(index.index) < MIN_SAMPLES:
        raise UnusableError(
            Status.TOO_SHORT,
            f"{data.recording.source}: {len(index.index)} independent samples of motion below {band_hz:.3g} Hz, a "
            f"regression needs {MIN_SAMPLES}: record longer, or give a wider band (band_hz)",
        )
    found, missing = [], missing_torques(moved, model)
    for equation in equations(model, moved, values, data.free):
        drive = equation.factor * moved.u[model.torque_drive] if model.torque_drive else np.zeros(len(usable))
        table, last = np.column_stack([equation.y, equation.columns, *missing.values(), drive]), 1 + len(equation.names)
        table[~usable] = np.nan
        table = smoothed(data.recording.time, table, band_hz)
        drive, table = table[:, -1], table[index.index, :-1]
        known = np.isfinite(table).all(axis=1)
        here, table = Rows(index.index[known], index.pieces[known]), table[known]
        positive = [model.parameter(n).positive for n in equation.names]
        y, columns = table[:, 0], table[:, 1:last]
        ends = last + np.cumsum([more.shape[1] for more in missing.values()])
        lacked = dict(zip(missing, np.split(table[:, : ends[-1]], [last, *ends[:-1]], axis=1)[1:], strict=True))
        samples = Samples(equation, here, y, columns, lacked, data.recording.time, drive, data.period)
        solution = solve(y, columns, positive, here.pieces, lag_s / samples.step)
        found.append(tested(samples, solution, positive, moved, band_hz))
    if not found:
        raise UnusableError(
            Status.MISSING_SIGNAL,
            f"{data.recording.source}: no equation of {model.name} is linear in {listed(data.free)}: use the estimator "
            "innovations",
        )
    return band_hz, found


def _estimate(data: FitData, fitted: list[Fitted], band_hz: float, begun: float) -> Estimate:
    """Return the estimate."""
    model, held = data.model, not_linear(data.model, [f.samples.equation for f in fitted], data.free)
    free = tuple(n for f in fitted for n in f.names)
    order = [free.index(n) for n in data.free if n in free]
    covariance = np.zeros((len(free), len(free)))
    at, found = 0, dict[str, ParameterEstimate]()
    for f in fitted:
        k = len(f.names)
        covariance[at : at + k, at : at + k] = np.nan_to_num(f.solution.covariance, nan=0.0)
        at += k
        for j, name in enumerate(f.names):
            found[name] = row(model, name, f.solution, j, float(data.p[model.parameter_names.index(name)]))
    rows_ = tuple(
        found.get(q.name, ParameterEstimate(q.name, q.unit, v, np.nan, Verdict.FIXED, v, "held at this value"))
        for q, v in zip(model.parameters, data.p.tolist(), strict=True)
    )
    status, notes = judge(fitted, found, held, band_hz, data.dropped)
    nrmse, predictions = _predictions(data, fitted)
    seen = data.recording.time[fitted[0].samples.rows.index]
    return Estimate(
        model=model.name, estimator=Regression.name, status=status, message=message(notes), parameters=rows_,
        free=tuple(free[i] for i in order), covariance=covariance[np.ix_(order, order)], nrmse=nrmse,
        observations=sum(len(f.samples.y) for f in fitted), elapsed_s=time.perf_counter() - begun, start=float(seen[0]),
        end=float(seen[-1]), samples=sum(len(f.samples.y) for f in fitted), predictions=predictions, notes=notes,
        model_options=options_of(model), **origin_of(data.recording),
    )  # fmt: skip


def _predictions(data: FitData, fitted: list[Fitted]) -> tuple[dict[str, float], Predictions]:
    """Return rms error over standard deviation, and measurement and prediction, of the drive in the band."""
    drive, f = data.model.torque_drive, next(f for f in fitted if f.samples.equation.factor)
    assert drive is not None
    measured, predicted = (
        f.samples.y / f.samples.equation.factor,
        f.samples.columns @ f.solution.values / f.samples.equation.factor,
    )
    time_, nrmse = data.recording.time[f.samples.rows.index], float(np.sqrt(max(0.0, 1.0 - f.solution.r_squared)))
    return {drive: nrmse}, Predictions(time_, {drive: measured}, {drive: predicted})
