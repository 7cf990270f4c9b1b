"""How many RK4 steps a sample needs before the fit can judge by itself."""

from __future__ import annotations

import numpy as np

from joint_id_core.codegen import Kernel
from joint_id_core.estimators.start import start_state
from joint_id_core.problem import Problem
from joint_id_core.recording import Array

# RK4 is stable up to |lambda h| = 2.78 on the negative real axis; accuracy is left to the doubling test of
# the fit. The cap is for wild intermediate parameter values, whose fits need not be accurate.
LIMIT = 2.0
MOST = 8
POINTS = 5


def fastest_mode(problem: Problem, kernel: Kernel, p: Array) -> float:
    """Largest |lambda| in 1/s of the linearised model at a few points of the record."""
    at = np.linspace(0, len(problem.time) - 1, POINTS).astype(int)
    X = np.array([start_state(problem, int(k))[0] for k in at])
    for i, state in enumerate(problem.label_states):
        X[:, state] = np.where(np.isfinite(problem.y[at, i]), problem.y[at, i], X[:, state])
    A = np.empty((POINTS, X.shape[1], X.shape[1]))
    kernel.module.jacobians(X, np.ascontiguousarray(problem.u[at]), p, A)
    return float(np.max(np.abs(np.linalg.eigvals(A)))) if np.isfinite(A).all() else np.inf


def stable_substeps(problem: Problem, kernel: Kernel, p: Array, limit: float = LIMIT, most: int = MOST) -> int:
    """RK4 steps a sample so that |lambda h| <= limit for the fastest mode."""
    return int(np.clip(np.ceil(fastest_mode(problem, kernel, p) * problem.period / limit), 1, most))
