"""Noise levels that maximise the innovations likelihood, with the parameters held."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from joint_id_core.estimators.recursion import Recursion
from joint_id_core.estimators.start import label_floor, noise_ceiling
from joint_id_core.recording import Array


def fit_noise(recursion: Recursion, free: Array, R: Array, q: Array, substeps: int) -> tuple[Array, Array]:
    """Maximise the likelihood over log R and log q from the given levels.

    Returns:
        R (labels,), q (inputs,): variances, never below the resolution of a label or 1e-6 of the typical
        size of an input, and for measured motions never above what the signal shows. The noise of a drive
        has no such bound: it stands for everything the model does not know about the torque.
    """
    problem = recursion.problem
    n = len(R)
    inputs = zip(problem.model.inputs, problem.u.T, strict=True)
    limits = [(label_floor(c[np.isfinite(c)]), noise_ceiling(c)) for c in problem.y.T]
    limits += [
        ((1e-6 * s.scale) ** 2, noise_ceiling(c) if s.hold == "first" else (1e3 * s.scale) ** 2) for s, c in inputs
    ]
    bounds = [(np.log(low), np.log(max(high, low))) for low, high in limits]
    start = np.clip(np.log(np.concatenate([R, q])), *np.array(bounds).T)

    def cost(levels: Array) -> tuple[float, Array]:
        v = np.exp(levels)
        c, score_R, score_q = recursion.cost_and_score(free, v[:n], v[n:], substeps)
        if not np.isfinite(c):
            return 1e30, np.zeros_like(levels)
        return c, v * np.concatenate([score_R, score_q])

    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60, "ftol": 1e-9})
    v = np.exp(found.x)
    return v[:n], v[n:]
