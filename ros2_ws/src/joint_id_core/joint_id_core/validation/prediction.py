"""Prediction of data that the fit has not seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from joint_id_core.cell.kernel import Kernel, compile_model
from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.noise import NoiseLevels
from joint_id_core.estimators.innovations.recursion import LONGEST_GAP, Recursion
from joint_id_core.estimators.shared.fit_data import FitData, prepare
from joint_id_core.estimators.shared.free_run import block_length, free_runs
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.substeps import steps_of
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate
from joint_id_core.validation.inverse_dynamics import drive, drive_errors

HORIZON_S = 0.1  # how far ahead labels are predicted, as in the estimator's own report


def held_out(model: Model, recording: Recording, estimate: Estimate, horizon_s: float = HORIZON_S) -> dict[str, float]:
    """Predict the labels of another recording with the parameters of an estimate; nothing is fitted here.

    Returns:
        By label, rms of prediction minus label over the label's standard deviation; NaN for a constant label.

    Raises:
        JointIdError: as `held_out_errors`.
    """
    errors = held_out_errors(model, recording, estimate, horizon_s)
    return {n: float(np.sqrt(np.nanmean(e**2))) if np.isfinite(e).any() else float("nan") for n, e in errors.items()}


def held_out_errors(
    model: Model, recording: Recording, estimate: Estimate, horizon_s: float = HORIZON_S
) -> dict[str, Array]:
    """Errors of the predicted labels of another recording, sample by sample.

    Predictions are free runs of at most `horizon_s`, each restarted from the filtered state. Left out are runs that
    begin less than a horizon after the start of the record or after a long gap, when the filter hardly knows the
    state: the error of a guessed velocity, not of the model, would be most of what is left.

    Returns:
        By label, prediction minus label over the label's standard deviation, shape (T,) as `recording.time`; NaN where
        left out or not measured, and everywhere for a constant label; infinite where the prediction runs away.

    Raises:
        JointIdError: the recording cannot be used with this model, or is too short to predict anything.
    """
    data = prepare(model, recording, ParameterSettings.of_estimate(estimate))
    kernel = compile_model(model, "tanh", data.freed, estimate.cell)
    states, steps = filtered(data, kernel, estimate.noise, estimate.substeps)
    predictions = free_runs(kernel, data, states, data.p, steps, horizon_s)
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


def filtered(data: FitData, kernel: Kernel, noise: Mapping[str, float], substeps: int) -> tuple[Array, Steps]:
    """States of a record filtered with the start values of `data`, and the steps a sample that it took.

    Args:
        data: the record, with the values to use as its start values.
        kernel: of its model and cell.
        noise: standard deviations as in `Estimate.noise`; those that are missing or zero are taken from the record.
        substeps: as in `Estimate.substeps`.

    Returns:
        States, shape (T, n), and steps from each sample to the next, shape (T,).
    """
    rough = NoiseLevels.of(data).rough
    levels = np.array(
        [v if not noise.get(n, 0.0) > 0.0 else noise[n] ** 2 for n, v in zip(data.noise_names, rough, strict=True)]
    )
    steps = steps_of(data, kernel, data.p, rough_states(data), max(1, substeps))
    recursion = Recursion(data, kernel)
    return recursion.run(data.p[recursion.index], levels, steps).states, steps


def _settled(data: FitData, horizon_s: float) -> np.ndarray:
    """Which samples, shape (T,), belong to free runs that began at least a horizon after the last (re)start."""
    time, block = data.time, block_length(data, horizon_s)
    again = np.flatnonzero(data.gap > LONGEST_GAP) + 1
    starts = time[np.concatenate([[0], again[again < len(time)]])]
    since = starts[np.searchsorted(starts, time, "right") - 1]
    index = np.arange(len(time))
    begun = time[np.maximum(index - 1, 0) // block * block]
    return np.asarray((index > 0) & (begun - since > horizon_s - 0.5 * data.period))


def held_out_drive(model: Model, recording: Recording, estimate: Estimate) -> tuple[str, float] | None:
    """Name of the drive and R^2 of its prediction on another recording; None as `held_out_drive_errors`."""
    found = held_out_drive_errors(model, recording, estimate)
    return None if found is None else (found[0], 1.0 - float(np.nanmean(found[1] ** 2)))


def held_out_drive_errors(model: Model, recording: Recording, estimate: Estimate) -> tuple[str, Array] | None:
    """Name of the drive and the errors of its prediction on another recording, sample by sample.

    Returns:
        Name, and predicted minus measured drive in the band of `drive_errors` over the standard deviation of
        the measured one, shape (T,), NaN where not known. None where the model has no such drive, the motion that it
        needs was not recorded, or the recording is shorter than the filter needs.
    """
    predicted = drive(model, estimate.values, recording)
    name = model.inputs[0].name
    if predicted is None or name not in recording:
        return None
    errors = drive_errors(recording.time, recording[name], predicted)
    return (name, errors) if np.isfinite(errors).any() else None
