"""Prediction of data that the fit has not seen."""

from __future__ import annotations

import numpy as np

from joint_id_core.codegen import compile_model
from joint_id_core.estimate import Estimate
from joint_id_core.estimators.recursion import Recursion
from joint_id_core.estimators.start import input_noise, label_noise
from joint_id_core.models import Model
from joint_id_core.prediction import drive, drive_r_squared, free_runs, nrmse
from joint_id_core.problem import prepare
from joint_id_core.recording import Recording


def held_out(model: Model, recording: Recording, estimate: Estimate, horizon_s: float = 0.1) -> dict[str, float]:
    """Predict the labels of another recording with the parameters of an estimate.

    As in the estimator's own report, predictions are free runs of at most `horizon_s`, each restarted from the
    filtered state; nothing is fitted here.

    Returns:
        By label, rms of prediction minus label over the label's standard deviation.

    Raises:
        JointIdError: the recording cannot be used with this model.
    """
    held = set(model.parameter_names) - set(estimate.free)
    problem = prepare(model, recording, estimate.values, held, estimate.free)
    extra = tuple(n for n in estimate.free if model.parameter(n).fixed)
    kernel = compile_model(model, "tanh", extra)
    recursion = Recursion(problem, kernel)
    known = {name: std**2 for name, std in estimate.noise.items() if std > 0.0}
    R = np.array([known.get(n, v) for n, v in zip(problem.labels, label_noise(problem), strict=True)])
    q = np.array([known.get(f"input {n}", v) for n, v in zip(model.input_names, input_noise(problem), strict=True)])
    substeps = max(1, estimate.substeps)
    states = recursion.run(problem.p[recursion.index], R, q, substeps).states
    predictions = free_runs(kernel, problem, states, problem.p, substeps, horizon_s)
    return nrmse(problem, predictions)


def held_out_drive(model: Model, recording: Recording, estimate: Estimate) -> tuple[str, float] | None:
    """Name of the drive and R^2 of its prediction on another recording; None where the model has no such drive."""
    predicted = drive(model, estimate.values, recording)
    name = model.inputs[0].name
    if predicted is None or name not in recording:
        return None
    return name, drive_r_squared(recording.time, recording[name], predicted)
