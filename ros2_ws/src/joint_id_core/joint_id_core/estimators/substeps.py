"""How many RK4 steps a sample needs before the fit can judge by itself."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from joint_id_core.operations import SmoothOps
from joint_id_core.problem import Problem
from joint_id_core.recording import Array

# RK4 is stable up to |lambda h| = 2.78 on the negative real axis; accuracy is left to the doubling test of
# the fit. The cap is for wild intermediate parameter values, whose fits need not be accurate.
LIMIT = 2.0
MOST = 8


def stable_substeps(problem: Problem, p: Array, limit: float = LIMIT, most: int = MOST) -> int:
    """RK4 steps a sample so that |lambda h| <= limit for the fastest mode at a few points of the record."""
    model = problem.model
    values = SimpleNamespace(**dict(zip(model.parameter_names, map(float, p), strict=True)))
    fastest = 0.0
    for t in np.linspace(0, len(problem.time) - 1, 5).astype(int):
        x = np.zeros(len(model.states))
        x[problem.label_states] = np.nan_to_num(problem.y[t])
        fastest = max(fastest, float(np.max(np.abs(np.linalg.eigvals(_jacobian(problem, x, problem.u[t], values))))))
    return int(np.clip(np.ceil(fastest * problem.period / limit), 1, most))


def _jacobian(problem: Problem, x: Array, u: Array, values: SimpleNamespace) -> Array:
    """df/dx by central differences; only its eigenvalues' size matters here."""
    model = problem.model
    scale = np.array([s.scale for s in model.states]) * 1e-7
    columns = []
    for i, h in enumerate(scale):
        dx = np.zeros_like(x)
        dx[i] = h
        up = np.array(model.derivative(list(x + dx), list(u), values, SmoothOps()))
        down = np.array(model.derivative(list(x - dx), list(u), values, SmoothOps()))
        columns.append((up - down) / (2 * h))
    return np.column_stack(columns)
