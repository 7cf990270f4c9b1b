"""Free runs: short simulations without feedback, each restarted from the filtered state."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.cell.rollout import Steps, restarted
from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.fit_data import FitData


def block_length(data: FitData, horizon_s: float) -> int:
    """Return the number of samples of a free run of at most `horizon_s`, at least 1.

    The horizon may be exceeded by a quarter of a sample. So the last digits of the period do not change the result at
    usual rates: 0.1 s are 50 samples at 500 Hz and 12 at 125 Hz.
    """
    return max(1, math.floor(horizon_s / data.period + 0.25))


def free_runs(
    kernel: Kernel, data: FitData, states: Array, p: Array, substeps: int | Steps, horizon_s: float
) -> dict[str, Array]:
    """Predict the labels at most `horizon_s` ahead, by simulations restarted from the filtered `states` (T, n).

    Returns:
        By label, the predicted values, shape (T,), NaN at rest.
    """
    block, X = block_length(data, horizon_s), np.full_like(states, np.nan)
    steps = np.full(len(data.time), substeps, dtype=np.int64)
    # No run goes across a rest or a long gap.
    edges = np.unique([0, *data.starts, *(np.flatnonzero(data.rest[1:] & ~data.rest[:-1]) + 1), len(data.time)])
    for begin, end in pairwise(edges.tolist()):
        if not data.rest[begin]:
            rows = slice(begin, end)
            X[rows] = restarted(kernel, states[rows][::block], block, data.time[rows], data.u[rows], p, steps[rows])
    if data.model.label_delays:
        states, X = X, np.empty_like(X)
        kernel.module.observations(states, data.u, p, X)
    return {name: X[:, k] for name, k in zip(data.labels, data.label_states, strict=True)}


def nrmse(data: FitData, predictions: dict[str, Array]) -> dict[str, float]:
    """Return, by label, the rms of prediction minus label over the label's standard deviation.

    NaN for a constant label; infinite for a prediction that is not finite.
    """
    found = {}
    for k, (name, y) in enumerate(zip(data.labels, data.rows, strict=True)):
        predicted = predictions[name] if len(y) == len(data.y) else predictions[name][data.present[:, k]]
        away, error = y - y.sum() / max(1, len(y)), predicted - y
        spread = float(away @ away)
        with np.errstate(over="ignore"):  # the error of a prediction that diverged is infinite
            miss = math.sqrt(error @ error / spread) if spread > 0.0 else math.nan
        found[name] = math.inf if spread > 0.0 and math.isnan(miss) else miss
    return found
