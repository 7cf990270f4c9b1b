"""Prediction of held-out data with the parameters of an estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from joint_id_core.arguments import require_type
from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.filtered import filtered
from joint_id_core.estimators.shared.fit_data import FitData, prepare
from joint_id_core.estimators.shared.free_run import block_length, free_runs
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Predictions
from joint_id_core.validation.inverse_dynamics import drive, drive_errors

HORIZON_S = 0.1  # how far ahead labels are predicted, as in the estimator's own report


def held_out(model: Model, recording: Recording, estimate: Estimate, horizon_s: float = HORIZON_S) -> dict[str, float]:
    """Predict the labels of another recording with the parameters of an estimate, without a fit.

    Returns:
        By label, rms of prediction minus label over the label's standard deviation; NaN for a constant label.

    Raises:
        JointIdError: as `held_out_errors`.
    """
    errors = held_out_errors(model, recording, estimate, horizon_s)
    with np.errstate(over="ignore"):  # of a prediction that goes astray
        return {n: float(np.sqrt(np.nanmean(e**2))) if np.isfinite(e).any() else math.nan for n, e in errors.items()}


def held_out_errors(
    model: Model, recording: Recording, estimate: Estimate, horizon_s: float = HORIZON_S
) -> dict[str, Array]:
    """Return the errors of the predicted labels of another recording, sample by sample.

    Predictions are free runs of at most `horizon_s`, each restarted from the filtered state. Runs that begin less than
    a horizon after the start of the record, or after a long gap, are left out. There the filter hardly knows the
    state, and the error would come mostly from a guessed velocity and not from the model.

    Returns:
        By label, prediction minus label over the label's standard deviation, shape (T,) as `recording.time`. NaN where
        left out or not measured, and everywhere for a constant label; infinite where the prediction diverges.

    Raises:
        JointIdError: the recording cannot be used with this model, or is too short to predict anything; an argument of
            another type.
    """
    require_type("model", model, Model, 'make it with build("rigid_joint")')
    require_type("recording", recording, Recording, 'make it with read("motion.csv")')
    require_type("estimate", estimate, Estimate, "make it with fit(model, recording)")
    data, predictions = _free_runs(model, recording, estimate, horizon_s)
    judged = _settled(data, horizon_s)
    if not judged.any():
        raise JointIdError(
            f"{recording.source}: {recording.duration:.3g} s without a gap are too short to validate on, predictions "
            f"reach {horizon_s:g} s ahead and begin after {horizon_s:g} s: validate on a longer recording"
        )
    at = np.searchsorted(recording.time, data.time[judged])
    errors = {}
    for k, name in enumerate(data.labels):
        spread = float(np.nanstd(data.y[:, k]))
        errors[name] = np.full(len(recording), np.nan)
        if spread > 0.0:
            lost = np.isfinite(data.y[:, k]) & ~np.isfinite(predictions[name])
            errors[name][at] = np.where(lost, np.inf, (predictions[name] - data.y[:, k]) / spread)[judged]
    return errors


def predicted(
    model: Model, recording: Recording, estimate: Estimate, horizon_s: float = HORIZON_S
) -> Predictions:  # fmt: skip
    """Return the labels of a recording, and what the parameters of an estimate predict of them: see `held_out_errors`.

    Raises:
        JointIdError: the recording cannot be used with this model.
    """
    data, predictions = _free_runs(model, recording, estimate, horizon_s)
    judged = _settled(data, horizon_s)
    shown = {name: np.where(judged, predictions[name], np.nan) for name in data.labels}
    return data.predictions(shown, horizon_s)


def _free_runs(
    model: Model, recording: Recording, estimate: Estimate, horizon_s: float
) -> tuple[FitData, Mapping[str, Array]]:
    """Return the data of a recording, and predictions (T,) of the states by name."""
    data = prepare(model, recording, ParameterSettings.of_estimate(estimate))
    kernel = compile_model(model, "tanh", data.freed, estimate.cell)
    found = filtered(data, kernel, estimate.noise, estimate.substeps)[0]
    return data, free_runs(kernel, data, found.states, data.p, found.steps, horizon_s)


def _settled(data: FitData, horizon_s: float) -> np.ndarray:
    """Return True, shape (T,), for samples of free runs that began at least a horizon after the last (re)start."""
    time, block = data.time, block_length(data, horizon_s)
    again = data.starts
    starts = time[np.concatenate([[0], again[again < len(time)]])]
    since = starts[np.searchsorted(starts, time, "right") - 1]
    index = np.arange(len(time))
    begun = time[np.maximum(index - 1, 0) // block * block]
    return np.asarray((index > 0) & (begun - since > horizon_s - 0.5 * data.period))


def held_out_drive(model: Model, recording: Recording, estimate: Estimate) -> tuple[str, float] | None:
    """Return the name of the drive and R^2 of its prediction on another recording; None as `held_out_drive_errors`."""
    found = held_out_drive_errors(model, recording, estimate)
    return None if found is None else (found[0], 1.0 - float(np.nanmean(found[1] ** 2)))


def held_out_drive_errors(model: Model, recording: Recording, estimate: Estimate) -> tuple[str, Array] | None:
    """Predict the drive of another recording and return its name and errors, sample by sample.

    Returns:
        Name, and predicted minus measured drive in the band of `drive_errors` over the standard deviation of
        the measured one, shape (T,), NaN where not known. None if the model is driven by a voltage, a signal was not
        recorded, or the recording is too short for the filter.
    """
    predicted = drive(model, dict(ParameterSettings.of_estimate(estimate).values), recording)
    name = model.torque_drive
    if predicted is None or name is None or name not in recording:
        return None
    errors = drive_errors(recording.time, recording[name], predicted)
    return (name, errors) if np.isfinite(errors).any() else None
