"""One pass of the innovations form over a record: cost, gradient, Gauss-Newton matrix, noise information."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.kernel import Kernel
from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import start_state

# Variance added to each state per sample, in addition to the input noise, relative to the square of the state's range.
# It only keeps the covariance positive definite when an input is exact.
STATE_NOISE = 1e-18


class NoiseInformation(NamedTuple):
    """What a record says of the logarithms of the noise levels.

    Attributes:
        score: minus half the slope of the cost, shape (L,).
        matrix: information matrix, shape (L, L).
        cross: information on the free parameters, by their physical values, and the levels together, shape (free, L);
            (0, L) where it was not asked for.
    """

    score: Array
    matrix: Array
    cross: Array


@dataclass(frozen=True)
class Pass:
    """Result of one pass. Gradient and matrix refer to the physical values of the free parameters.

    Attributes:
        cost: sum of e^2/S + log S over all labels.
        errors, variances: innovations e and their variances S, shape (T, labels); 0 and 1 where a label is missing. S
            is infinite where labels tell the state only (`FitData.settling`).
        hessian: Gauss-Newton matrix, shape (free, free): sum s s', s the derivative of a predicted label over sqrt(S).
        gradient: sum s e/sqrt(S), minus half the slope of the cost, shape (free,).
        states: filtered states, shape (T, n).
        free, levels, steps: the arguments of the pass: free parameters, noise variances, integrator steps.
        noise: what the record says of the noise levels, if the pass has computed it on its way.
    """

    cost: float
    errors: Array
    variances: Array
    hessian: Array
    gradient: Array
    states: Array
    free: Array
    levels: Array
    steps: Steps
    noise: NoiseInformation | None = None

    @cached_property
    def residuals(self) -> Array:
        """Normalised innovations e/sqrt(S), shape (T, labels), 0 where a label is missing."""
        return np.asarray(self.errors / np.sqrt(self.variances))


class Recursion:
    """The compiled innovations recursion on fixed data, called with parameters and noise levels.

    Noise levels are variances, those of the labels (R) before those of the inputs (q): shape (labels + inputs,).

    Args:
        data: the record.
        kernel: the compiled cell of its model.
        near: values of all parameters, near the truth. The start states, at the begin of the record and after long
            gaps, are computed with them. None if such values are not known.
    """

    def __init__(self, data: FitData, kernel: Kernel, near: Array | None = None) -> None:
        self.data, self.kernel, self._near = data, kernel, near
        self._columns = np.array([kernel.sensitive.index(name) for name in data.free])
        self.index = np.array([data.model.parameter_names.index(name) for name in data.free])
        self._after = data.starts
        if data.rest[-1:].any():
            self._after = np.union1d(self._after, 1 + np.flatnonzero(~data.rest)[-1:])
        self._begin = np.full(len(data.time), -1, dtype=np.int64)
        self._begin[self._after] = np.arange(len(self._after))
        for k in np.flatnonzero(data.rest)[::-1]:  # no state is predicted while the joint rests
            if self._begin[k] < 0:
                self._begin[k] = self._begin[k + 1] if k + 1 < len(data.time) else len(self._after) - 1
        self.x0, spread = start_state(data, 0, near)
        self.P0, self.Q_x = np.diag(spread**2), STATE_NOISE * spread**2
        starts = [start_state(data, int(k), near) for k in self._after] or [(self.x0, spread)]
        self._X0 = np.array([mean for mean, _ in starts])
        self._V0 = np.array([spread for _, spread in starts]) ** 2
        T, n, m = len(data.time), len(self.x0), len(data.labels)
        self._K, self._F = np.empty((T, m, n)), np.empty((T, n, n + data.u.shape[1]))
        self._C = np.empty((T, m, n) if data.model.label_delays else (1, 1, 1))
        self._J, self._no_parameters = np.empty((T, m, len(kernel.sensitive))), np.empty((T, m, 0))
        self._F[-1] = 0.0
        self._latest: Pass | None = None

    @property
    def restarts(self) -> dict[int, tuple[Array, Array]]:
        """Samples at which the state starts again, with its mean (n,) and variances (n,) there."""
        return {int(t): (self._X0[self._begin[t]], self._V0[self._begin[t]]) for t in np.flatnonzero(self._begin >= 0)}

    def started_near(self, near: Array | None) -> Recursion:
        """Return the same recursion with other values `near`."""
        return Recursion(self.data, self.kernel, near)

    def with_inputs(self, u: Array) -> Recursion:
        """Return the same recursion on other inputs, shape (T, inputs)."""
        return Recursion(replace(self.data, u=u), self.kernel, self._near)

    def with_held(self, p: Array) -> Recursion:
        """Return the same recursion with other values (P,) of the parameters that are held."""
        return Recursion(replace(self.data, p=p), self.kernel, self._near)

    def values(self, free: Array) -> Array:
        """Return the values of all parameters, shape (P,), with the given `free` ones."""
        p = self.data.p.copy()
        p[self.index] = free
        return p

    def run(self, free: Array, levels: Array, substeps: int | Steps) -> Pass:
        """Run one pass at the physical values `free`; its cost is not finite if the path diverges."""
        a = self.data
        T, m, k = len(a.time), len(a.labels), len(self.kernel.sensitive)
        X, e, S = np.empty((T, len(self.x0))), np.empty((T, m)), np.empty((T, m))
        H, g = np.empty((k, k)), np.empty(k)
        steps = substeps if isinstance(substeps, np.ndarray) else np.full(T, substeps, dtype=np.int64)
        cost = self.kernel.module.innovations(
            self.x0, self.P0, self._begin, self._X0, self._V0, a.time, a.u, a.y, a.label_states, a.gap,
            levels[:m], levels[m:], self.Q_x, self.values(free), steps, X, e, S, self._K, self._F, self._C, self._J,
            H, g,
        )  # fmt: skip
        if len(rows := a.settling) and np.isfinite(cost):
            white, J = (e[rows] / np.sqrt(S[rows])).ravel(), self._J[rows].reshape(-1, k)
            cost -= float(white @ white + np.log(S[rows]).sum())
            H -= J.T @ J
            g -= J.T @ white
            self._J[rows], S[rows] = 0.0, np.inf
        if k > len(free):  # some are held
            H, g = H[self._columns[:, None], self._columns], g[self._columns]
        self._latest = Pass(float(cost), e, S, H, g, X, free, levels, steps)
        return self._latest

    def disturbances(self, result: Pass, channel: NDArray[np.int64], course: Array) -> tuple[Array, Array, Array]:
        """Return information matrices and score of disturbances that are added to inputs.

        Let d be the derivatives of the predicted labels over sqrt(S) by the size of each disturbance, s those by the
        physical values of the free parameters, and r the residuals.

        Args:
            result: the latest pass.
            channel: index of the input that each disturbance is added to, shape (D,); the number of inputs stands for a
                torque at the motor, of a model whose drive is a voltage.
            course: disturbance of size 1 over time, in the unit of the input or in Nm, shape (T, D).

        Returns:
            sum s d' (free, D), sum d d' (D, D), and sum d r (D,).

        Raises:
            JointIdError: `result` is not the latest pass; more disturbances than the kernel has columns for.
        """
        self._require_latest(result)
        a, count, most = self.data, len(channel), self.kernel.gains.CD
        if count > most:
            raise JointIdError(f"{count} disturbances: their responses are computed for at most {most} at once")
        padded, inputs = np.zeros((len(a.time), most)), np.zeros(most, dtype=np.int64)
        padded[:, :count], inputs[:count] = course, channel
        cross, total, score = np.empty((self._J.shape[2], most)), np.empty((most, most)), np.empty(most)
        F = self._F if channel.max(initial=0) < a.u.shape[1] else self._with_motor(result)
        self.kernel.gains.disturbances(
            a.y, a.label_states, self._begin, result.errors, result.variances, self._K, F, self._C, self._J,
            inputs, padded, cross, total, score,
        )  # fmt: skip
        return cross[self._columns, :count], total[:count, :count], score[:count]

    def _with_motor(self, result: Pass) -> Array:
        """Return the derivatives of the next state, with one more column: by a torque at the motor in Nm."""
        model, step = self.data.model, np.append(np.diff(self.data.time), 0.0)
        rate = 1.0 / self.values(result.free)[model.parameter_names.index(model.motor_inertias[-1])]
        column = np.zeros((*self._F.shape[:2], 1))
        for name, by in (("motor_velocity", step * rate), ("motor_position", 0.5 * step * step * rate)):
            if name in model.state_names:
                column[:, model.state_names.index(name), 0] = by
        return np.concatenate([self._F, column], axis=2)

    def since(self, result: Pass, first: int) -> tuple[Array, Array]:
        """Return Gauss-Newton matrix and gradient as in `Pass`, but only of the samples from `first` on.

        Raises:
            JointIdError: `result` is not the latest pass.
        """
        self._require_latest(result)
        J = self._J[first:].reshape(-1, self._J.shape[2])[:, self._columns]
        return J.T @ J, J.T @ result.residuals[first:].ravel()

    def sensitivities(self, result: Pass) -> Array:
        """Return the derivatives of the predicted labels over sqrt(S) by the free parameters, shape (T, labels, free).

        Raises:
            JointIdError: `result` is not the latest pass.
        """
        self._require_latest(result)
        return np.asarray(self._J[:, :, self._columns])

    def scores(self, result: Pass) -> Array:
        """Return the contribution of each sample to the gradient, shape (T, free).

        Raises:
            JointIdError: `result` is not the latest pass.
        """
        self._require_latest(result)
        return np.asarray(np.einsum("tkp,tk->tp", self._J, result.residuals)[:, self._columns])

    def information(self, result: Pass, edges: NDArray[np.int64]) -> Array:
        """Return the Gauss-Newton matrix of each block of samples, shape (blocks, free, free), which begin at `edges`.

        Raises:
            JointIdError: `result` is not the latest pass.
        """
        self._require_latest(result)
        blocks = np.split(self._J[:, :, self._columns], edges[1:])
        return np.array([np.einsum("tkp,tkq->pq", J, J, optimize=True) for J in blocks])

    def renewed(self, result: Pass) -> Pass:
        """Return `result` as the latest pass: run it again if another pass came after it.

        Some methods need `result` to be the latest pass, because only its gains and derivatives are kept.
        """
        return result if result is self._latest else self.run(result.free, result.levels, result.steps)

    def _require_latest(self, result: Pass) -> None:
        if result is not self._latest:
            raise JointIdError("this is known of the latest pass only: run it again")

    def noise_information(self, result: Pass, with_parameters: bool = False) -> NoiseInformation:
        """Return what the record says of the logarithms of the noise levels, `with_parameters` also `cross`.

        Raises:
            JointIdError: `result` is not the latest pass, the only one whose gains are kept.
        """
        if result.noise is not None and not with_parameters:
            return result.noise
        self._require_latest(result)
        a, levels = self.data, result.levels
        score, matrix = np.empty_like(levels), np.empty((len(levels), len(levels)))
        J = self._J if with_parameters else self._no_parameters
        cross = np.empty((J.shape[2], len(levels)))
        self.kernel.gains.noise_information(
            a.y, a.label_states, self._begin, result.errors, result.variances, self._K, self._F, self._C, J,
            score, matrix, cross,
        )  # fmt: skip
        cross = cross[self._columns] * levels if with_parameters else cross
        return NoiseInformation(score * levels, matrix * np.outer(levels, levels), cross)
