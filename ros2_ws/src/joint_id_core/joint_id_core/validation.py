"""Prediction of data that the fit has not seen."""

from __future__ import annotations

import numpy as np

from joint_id_core import rk4
from joint_id_core.codegen import compile_model
from joint_id_core.estimate import Estimate
from joint_id_core.estimators.recursion import Recursion
from joint_id_core.estimators.start import input_noise, label_noise
from joint_id_core.models import Model
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
    last = len(problem.time) - 1
    block = max(1, round(horizon_s / problem.period))
    X = states.copy()
    for i in range(0, last, block):
        j = min(i + block, last)
        X[i + 1 : j + 1] = rk4.rollout(
            kernel, states[i], problem.time[i : j + 1], problem.u[i : j + 1], problem.p, substeps
        )[1:]
    error = X[:, problem.label_states] - problem.y
    with np.errstate(invalid="ignore", divide="ignore"):
        nrmse = np.sqrt(np.nanmean(error**2, axis=0)) / np.nanstd(problem.y, axis=0)
    return dict(zip(problem.labels, nrmse.tolist(), strict=True))
