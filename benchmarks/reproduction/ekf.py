"""Extended Kalman filter with the parameters as states: the classical online method, one pass over the record."""

from __future__ import annotations

import time
from collections.abc import Mapping

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array
from reproduction.cases import FACTOR, Case
from reproduction.runs import Run

SUBSTEPS = 16
DIFFERENCE = 1e-6
STATE_NOISE, LABEL_NOISE = 1e-6, 1e-4  # standard deviations of a sample over the range of each state: it has no other
SMOOTHING = 0.1  # rad/s


def fit(case: Case, seed: int) -> Run:
    """Run the filter; parameters are carried as logarithms, their spread at the start that of the starts."""
    model, start = case.model, case.start(seed)
    kernel = compile_model(model, "tanh", case.freed)
    values = {**case.truth, **start, **dict.fromkeys(model.smoothing.values(), SMOOTHING)}
    p = np.array([values[n] for n in model.parameter_names])
    index = [model.parameter_names.index(n) for n in case.free]
    n, k = len(model.states), len(index)
    span = np.ptp(case.states, axis=0)
    z = np.concatenate([case.states[0], np.log(p[index])])
    P = np.diag(np.concatenate([(1e-3 * span) ** 2, np.full(k, np.log(FACTOR) ** 2)]))
    Q = np.diag(np.concatenate([(STATE_NOISE * span) ** 2, np.zeros(k)]))
    columns = [model.state_names.index(name) for name in case.labels]
    R = (LABEL_NOISE * span[columns]) ** 2
    y = np.column_stack([case.recording[name] for name in case.labels])
    inputs = [case.recording.channels.get(name, np.zeros(len(case.recording))) for name in model.input_names]
    u, t = np.column_stack(inputs), case.recording.time
    steps, X = np.full(2, SUBSTEPS, dtype=np.int64), np.empty((2, n))

    def ahead(z: Array, at: int) -> Array:
        q = p.copy()
        q[index] = np.exp(z[n:])
        kernel.module.rollout(z[None, :n].copy(), 2, t[at : at + 2], u[at : at + 2], q, steps, X)
        return np.concatenate([X[1], z[n:]])

    ahead(z, 0)
    begun = time.process_time()
    for at in range(len(t)):
        for j, column in enumerate(columns):
            S = P[column, column] + R[j]
            gain = P[:, column] / S
            z = z + gain * (y[at, j] - z[column])
            P = P - np.outer(gain, P[column])
        if at == len(t) - 1:
            break
        size = DIFFERENCE * np.concatenate([span, np.ones(k)])
        F = np.column_stack([(ahead(z + d, at) - ahead(z - d, at)) / (2.0 * d.sum()) for d in np.diag(size)])
        z, P = ahead(z, at), F @ P @ F.T + Q
        P = 0.5 * (P + P.T)
        if not np.isfinite(z).all():
            return Run(values, time.process_time() - begun, f"not finite at sample {at}")
    found = dict(zip(case.free, np.exp(z[n:]).tolist(), strict=True))
    sigmas: Mapping[str, float] = {
        name: found[name] * float(np.sqrt(max(v, 0.0))) for name, v in zip(case.free, np.diag(P)[n:], strict=True)
    }
    return Run({**case.truth, **found}, time.process_time() - begun, "one pass", sigmas)
