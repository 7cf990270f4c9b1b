"""One pass of the innovations form over a problem: cost, gradient, Gauss-Newton matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.codegen import Kernel
from joint_id_core.estimators.start import start_state
from joint_id_core.problem import Problem
from joint_id_core.recording import Array

# Variance that each state gains a sample beside the input noise, relative to the square of its range.
# It only keeps the covariance positive when an input is exact.
STATE_NOISE = 1e-18

# Longest gap, in samples, over which the state is carried on. The input in between is not known: after a longer one
# (a connection that was cut) the record begins anew, with the same parameters.
LONGEST_GAP = 5


@dataclass(frozen=True)
class Pass:
    """Result of one pass. Gradient and matrix are by the physical values of the problem's free parameters.

    Attributes:
        cost: sum of e^2/S + log S over all labels.
        residuals: normalised innovations e/sqrt(S), shape (T, labels), 0 where a label is missing.
        jacobian: derivative of the predicted labels over sqrt(S), shape (T, labels, free).
        states: filtered states, shape (T, n).
    """

    cost: float
    residuals: Array
    jacobian: Array
    states: Array


class Recursion:
    """The compiled innovations recursion on fixed data, called with parameters and noise levels."""

    def __init__(self, problem: Problem, kernel: Kernel) -> None:
        self.problem = problem
        self.kernel = kernel
        self.columns = [kernel.sensitive.index(name) for name in problem.free]
        self.index = np.array([problem.model.parameter_names.index(name) for name in problem.free])
        mean, spread = start_state(problem)
        self.x0 = mean
        self.P0 = np.diag(spread**2)
        self.Q_x = STATE_NOISE * spread**2
        after = np.flatnonzero(problem.gap > LONGEST_GAP) + 1
        starts = [start_state(problem, int(k)) for k in after] or [(mean, spread)]
        self._begin = np.full(len(problem.time), -1, dtype=np.int64)
        self._begin[after] = np.arange(len(after))
        self._X0 = np.array([mean for mean, _ in starts])
        self._V0 = np.array([spread**2 for _, spread in starts])
        T, n, m = len(problem.time), len(mean), len(problem.labels)
        self._X = np.empty((T, n))
        self._e, self._S = np.empty((T, m)), np.empty((T, m))
        self._J = np.empty((T, m, len(kernel.sensitive)))
        self._K, self._F = np.empty((T, m, n)), np.empty((T, n, n + problem.u.shape[1]))

    def values(self, free: Array) -> Array:
        """All parameter values with the free ones put in."""
        p = self.problem.p.copy()
        p[self.index] = free
        return p

    def _run(self, free: Array, R: Array, q: Array, substeps: int, n_params: int) -> float:
        a = self.problem
        return float(
            self.kernel.module.innovations(
                self.x0, self.P0, self._begin, self._X0, self._V0, a.time, a.u, a.y, a.label_states, a.gap,
                R, q, self.Q_x, self.values(free), substeps, n_params,
                self._X, self._e, self._S, self._J, self._K, self._F,
            )
        )  # fmt: skip

    def cost_and_score(self, free: Array, R: Array, q: Array, substeps: int) -> tuple[float, Array, Array]:
        """Cost, without sensitivities, and its derivatives by R (labels,) and q (inputs,)."""
        cost = self._run(free, R, q, substeps, 0)
        score_R, score_q = np.empty(len(R)), np.empty(len(q))
        a = self.problem
        self.kernel.module.noise_score(a.y, a.label_states, self._e, self._S, self._K, self._F, score_R, score_q)
        return cost, score_R, score_q

    def run(self, free: Array, R: Array, q: Array, substeps: int) -> Pass:
        """Cost, residuals and sensitivities. The arrays are copies."""
        cost = self._run(free, R, q, substeps, len(self.kernel.sensitive))
        if not np.isfinite(cost):
            self._S.fill(1.0)  # a path that blew up; its cost tells the caller
        return Pass(cost, self._e / np.sqrt(self._S), self._J[:, :, self.columns], self._X.copy())
