"""Fit of a model by inverse-dynamics regression."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import scipy

from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import side_of
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.equations import Equation, equations
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.fitted import Fitted
from joint_id_core.estimators.regression.judging import estimates, judge, tested
from joint_id_core.estimators.regression.prepared import Prepared, prepared
from joint_id_core.estimators.shared.fit_data import (
    FitData,
    UnusableError,
    options_of,
    origin_of,
    prepare,
    unusable,
)
from joint_id_core.estimators.shared.mean_drive import MOST, POSITION, changes, with_mean_drive
from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.standing import not_known, standing
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Predictions, Status, Verdict, message

FITS = 4  # most of them until the share of the next sample is known


def fit_regression(
    model: Model, recording: Recording, settings: ParameterSettings | None = None, options: Regression | None = None
) -> Estimate:
    """Fit a model to a recording: see `estimators.fit`.

    Raises:
        JointIdError: misuse of names or values, priors, a model that a regression does not suit. Poor data come back
            as an `Estimate` with a status.
    """
    begun, options = time.perf_counter(), options or Regression()
    _require_suitable(model)
    if settings is not None and settings.priors:
        raise JointIdError("estimator regression takes no priors: leave them out, or use the estimator innovations")
    try:
        data, band_hz, fitted, share = with_share(model, recording, settings, options)
    except UnusableError as error:
        return unusable(model, Regression.name, error, recording, settings)
    return _estimate(data, fitted, band_hz, begun, [changes(model, share)] if share > 0.0 else [])


def regressed(model: Model, recording: Recording, settings: ParameterSettings, options: Regression) -> list[Fitted]:
    """Return the fits of the equations of a model alone.

    Raises:
        JointIdError: as `fit_regression`.
        UnusableError: the recording cannot be used.
    """
    _require_suitable(model)
    return fitted_equations(prepare(model, recording, settings, leave_out_rests=True), options)[1]


def with_share(
    model: Model, recording: Recording, settings: ParameterSettings | None, options: Regression, known: float = 0.0
) -> tuple[FitData, float, list[Fitted], float]:
    """Fit the equations of a model, with a mean drive (`shared.mean_drive`) if it comes late by less than a sample.

    Intervals contain what is not known of that.

    Args:
        model, recording, settings, options: as of `fit_regression`.
        known: share of the next sample; 0 looks for it.

    Returns:
        the data that were fitted, the band in Hz, the fits, and the share.

    Raises:
        UnusableError: as `fitted_equations`.
    """

    def fitted_with(share: float) -> tuple[FitData, float, list[Fitted]]:
        part = with_mean_drive(model, recording, share, POSITION) if share > 0.0 else recording
        data = prepare(model, part, settings, leave_out_rests=True)
        return data, *fitted_equations(data, options)

    data, band_hz, fitted = fitted_with(0.0)
    driven, share = next((f for f in fitted if f.samples.equation.factor), None), 0.0
    if driven is not None and not driven.shifted:
        late = driven.share
        share = known or (min(late.value, MOST) if late is not None and late.sure else 0.0)
    for left in reversed(range(FITS if share > 0.0 else 0)):
        data, band_hz, fitted = fitted_with(share)
        late = next(f.share for f in fitted if f.samples.equation.factor)
        if not left or known or late is None or abs(late.value) < late.sigma:
            break
        share = float(np.clip(share + late.value, 0.0, MOST))
    return data, band_hz, [f.with_delay_in_doubt(share > 0.0) for f in fitted], share


def suits(model: Model) -> bool:
    """Return whether a regression suits a model: it needs a drive, and states on one side of the gear."""
    return model.drive is not None and len({side_of(n) for n in model.state_names} - {None}) == 1


def _require_suitable(model: Model) -> None:
    if not suits(model):
        raise JointIdError(
            f"estimator regression does not suit model {model.name}: it needs a drive, and states on one side of the "
            "gear. Use the estimator innovations, or model rigid_joint or motor_side"
        )


def fitted_equations(data: FitData, options: Regression) -> tuple[float, list[Fitted]]:
    """Fit every equation of the model that holds free parameters; return the band in Hz, and the fits.

    Raises:
        JointIdError, UnusableError: as `prepared`; or no equation is linear.
    """
    ready = prepared(data, options)
    found = [_fitted(ready, each, options) for each in equations(ready.model, ready.moved, ready.values, ready.free)]
    if not found:
        raise UnusableError(
            Status.MISSING_SIGNAL,
            f"{data.recording.source}: no equation of {data.model.name} is linear in {listed(data.free)}: use the "
            "estimator innovations",
        )
    return ready.band_hz, found


def _fitted(ready: Prepared, equation: Equation, options: Regression) -> Fitted:
    """Fit an equation."""
    samples, tables = ready.compared(equation)
    positive = [ready.model.parameter(n).positive for n in equation.names]
    solution, lag, share = samples.solve(positive, options.lag_s), None, samples.share(positive, options.lag_s)
    if ready.sides is not None:
        solution, lag = ready.sides.with_lag_in_doubt(equation.names, samples.y, tables, solution)
    stiff = (ready.model.stiffness, ready.model.cubic_stiffness)
    gear = [ready.sides is not None and n in stiff for n in equation.names]
    return tested(samples, solution, positive, ready.moved, ready.band_hz, share, lag, gear)


def _estimate(data: FitData, fitted: list[Fitted], band_hz: float, begun: float, told: list[str]) -> Estimate:
    """Return the estimate; `told` is said of the recording."""
    model, starts = data.model, dict(zip(data.model.parameter_names, data.p.tolist(), strict=True))
    found = {n: r for f in fitted for n, r in estimates(model, f, starts).items()}
    stuck = standing(data)
    for n in found.keys() & stuck:
        verdict, why = Verdict.NOT_EXCITED, "the link does not slide"
        found[n] = replace(found[n], value=starts[n], std_dev=np.nan, verdict=verdict, reason=why)
    known, held = tuple(n for n in data.free if n in found), tuple(n for n in data.free if n not in found)
    covariance = scipy.linalg.block_diag(*(np.nan_to_num(f.covariance, nan=0.0) for f in fitted))
    order = [[*found].index(n) for n in known]
    rows_ = tuple(
        found.get(q.name, ParameterEstimate(q.name, q.unit, v, np.nan, Verdict.FIXED, v, "held at this value"))
        for q, v in zip(model.parameters, data.p.tolist(), strict=True)
    )
    status, notes = judge(data.model, fitted, found, held, band_hz, data.dropped)
    notes = (*notes[:2], *map(sentence, filter(None, (not_known(stuck), *told))), *notes[2:])
    nrmse, predictions = _predictions(data, fitted)
    seen = data.recording.time[fitted[0].samples.rows.index]
    return Estimate(
        model=model.name, estimator=Regression.name, status=status, message=message(notes), parameters=rows_,
        free=known, covariance=covariance[np.ix_(order, order)], nrmse=nrmse,
        observations=sum(len(f.samples.y) for f in fitted), elapsed_s=time.perf_counter() - begun, start=float(seen[0]),
        end=float(seen[-1]), samples=sum(len(f.samples.y) for f in fitted), predictions=predictions, notes=notes,
        model_options=options_of(model), **origin_of(data.recording),
    )  # fmt: skip


def _predictions(data: FitData, fitted: list[Fitted]) -> tuple[dict[str, float], Predictions]:
    """Return rms error over standard deviation, and measurement and prediction, of the drive in the band."""
    drive, f = data.model.drive, next(f for f in fitted if f.samples.equation.factor)
    assert drive is not None
    measured, predicted = (
        f.samples.y / f.samples.equation.factor,
        f.samples.columns @ f.solution.values / f.samples.equation.factor,
    )
    time_, nrmse = data.recording.time[f.samples.rows.index], float(np.sqrt(max(0.0, 1.0 - f.solution.r_squared)))
    return {drive: nrmse}, Predictions(time_, {drive: measured}, {drive: predicted})
