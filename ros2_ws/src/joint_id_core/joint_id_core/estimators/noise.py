"""Noise levels that maximise the innovations likelihood, with the parameters held."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from joint_id_core.estimators.recursion import Recursion
from joint_id_core.estimators.start import label_floor
from joint_id_core.recording import Array


def fit_noise(recursion: Recursion, free: Array, R: Array, q: Array, substeps: int) -> tuple[Array, Array]:
    """Maximise the likelihood over log R and log q from the given levels.

    Returns:
        R (labels,), q (inputs,): variances, never below the resolution of the labels and 1e-6 of the
        typical size of an input.
    """
    problem = recursion.problem
    n = len(R)
    floors_R = [label_floor(c[np.isfinite(c)]) for c in problem.y.T]
    floors_q = [(1e-6 * s.scale) ** 2 for s in problem.model.inputs]
    floor = np.log(np.array([*floors_R, *floors_q]))
    start = np.maximum(np.log(np.concatenate([R, q])), floor)

    def cost(levels: Array) -> float:
        v = np.exp(levels)
        c = recursion.cost(free, v[:n], v[n:], substeps)
        return c if np.isfinite(c) else 1e30

    bounds = [(f, max(s, f) + 30.0) for f, s in zip(floor, start, strict=True)]
    found = minimize(cost, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": 40, "ftol": 1e-10, "eps": 1e-4})
    v = np.exp(found.x)
    return v[:n], v[n:]
