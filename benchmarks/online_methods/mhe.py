"""Moving-horizon estimation with CasADi: real-time iterations (Diehl, Bock, Schloeder 2005) of Gauss-Newton.

Unknown are the state at the begin of the horizon, the logarithms of the parameters and the noise of the torque at
every sample. CasADi gives the states and exact derivatives of every step. What leaves the horizon is kept as an
arrival cost, the filtering update at the present solution (Rao and Rawlings 2002). It is told the noise levels. What is
known of the parameters is forgotten with the time constant of the others.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi
import numpy as np
from online.joints import TORQUE_NOISE
from peers.casadi_nlp import cell
from peers.model2 import FREE, MODEL

from joint_id_core.data.recording import Array
from online_methods.common import (
    KEPT,
    PERIOD_S,
    SIGMA_Q,
    SIGMA_W,
    SPREAD,
    START,
    Known,
    Signals,
    first_state,
    of_logarithms,
)

HORIZON, HOP = 50, 10  # samples
ITERATIONS, FIRST = 2, 20  # a hop; in the first horizon
STATES, PARAMETERS = len(MODEL.states), len(FREE)
KNOWN = STATES + PARAMETERS


@lru_cache(maxsize=1)
def rollout() -> Any:
    """States after each step of the horizon, and derivatives by state, parameters and torque; compiled."""
    x, torque = casadi.SX.sym("x", STATES), casadi.SX.sym("torque")
    z = casadi.SX.sym("z", PARAMETERS)
    later = cell()(x, casadi.vertcat(torque, 0.0), PERIOD_S, z)
    by_x, by_z, by_u = (casadi.densify(casadi.jacobian(later, v)) for v in (x, z, torque))
    step = casadi.Function("step", [x, torque, z], [later, by_x, by_z, by_u])
    options = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2", "-march=native"]}}
    return step.mapaccum("rollout", HORIZON, options)


class MovingHorizonEstimator:
    """State at the begin of the horizon, parameters, and noise of the torque."""

    def __init__(self) -> None:
        self._rollout = rollout()
        self._samples = Signals(*np.zeros((3, 0)))
        self._arrival: tuple[Array, Array] | None = None  # mean and covariance of state and parameters
        self._v = np.concatenate([np.zeros(STATES), START, np.zeros(HORIZON)])
        self._covariance = np.eye(KNOWN)
        self._iterations = FIRST

    def update(self, samples: Signals) -> None:
        """Take new samples and solve once the horizon is full."""
        if self._arrival is None:
            x, P = first_state(float(samples.q[0]))
            mean = np.concatenate([x, START])
            covariance = np.diag(np.concatenate([np.diag(P), np.full(PARAMETERS, SPREAD**2)]))
            self._arrival, self._v[:STATES], self._covariance = (mean, covariance), x, covariance
        old = self._samples
        self._samples = Signals(*(np.concatenate(pair) for pair in (
            (old.q, samples.q), (old.w, samples.w), (old.torque, samples.torque))))  # fmt: skip
        while len(self._samples.q) >= HORIZON:
            for _ in range(self._iterations):
                self._iterate()
            self._iterations = ITERATIONS
            self._shift()

    def _linear(self) -> tuple[Array, Array]:
        """States (HORIZON + 1, 4) and their derivatives (HORIZON + 1, 4, unknowns)."""
        x_0, z, w = np.split(self._v, [STATES, KNOWN])
        torque = self._samples.torque[:HORIZON] + TORQUE_NOISE * w
        x, by_x, by_z, by_u = (np.array(a) for a in self._rollout(x_0, torque, np.tile(z[:, None], HORIZON)))
        S = np.zeros((HORIZON + 1, STATES, KNOWN + HORIZON))
        S[0, :, :STATES] = np.eye(STATES)
        for k in range(HORIZON):
            S[k + 1] = by_x[:, STATES * k : STATES * (k + 1)] @ S[k]
            S[k + 1, :, STATES:KNOWN] += by_z[:, PARAMETERS * k : PARAMETERS * (k + 1)]
            S[k + 1, :, KNOWN + k] = TORQUE_NOISE * by_u[:, k]
        return np.vstack([x_0, x.T]), S

    def _problem(self, x: Array, S: Array, count: int) -> tuple[Array, Array]:
        """Step (n,) and covariance (n, n) of the first unknowns, from the first `count` samples."""
        assert self._arrival is not None
        n = KNOWN + count
        mean, covariance = self._arrival
        half = np.linalg.inv(np.linalg.cholesky(covariance))
        J, r = [np.hstack([half, np.zeros((KNOWN, count))])], [half @ (mean - self._v[:KNOWN])]
        for i, sigma, y in ((1, SIGMA_Q, self._samples.q), (2, SIGMA_W, self._samples.w)):
            J.append(S[:count, i, :n] / sigma)
            r.append((y[:count] - x[:count, i]) / sigma)
        J.append(np.hstack([np.zeros((count, KNOWN)), np.eye(count)]))
        r.append(-self._v[KNOWN:n])
        rows, right = np.vstack(J), np.concatenate(r)
        scale = 1.0 / np.linalg.norm(rows, axis=0)
        inverse = np.linalg.inv((rows * scale).T @ (rows * scale)) * np.outer(scale, scale)
        return inverse @ (rows.T @ right), inverse

    def _iterate(self) -> None:
        """One Gauss-Newton step over the whole horizon."""
        step, covariance = self._problem(*self._linear(), HORIZON)
        self._v = self._v + step
        self._covariance = covariance[:KNOWN, :KNOWN]

    def _shift(self) -> None:
        """Move the horizon; its first samples become a part of the arrival cost."""
        x, S = self._linear()
        step, covariance = self._problem(x, S, HOP)
        n = KNOWN + HOP
        to = np.vstack([S[HOP, :, :n], np.eye(n)[STATES:KNOWN]])
        fade = np.concatenate([np.ones(STATES), np.full(PARAMETERS, KEPT ** (-0.5 * HOP))])
        now = np.concatenate([x[HOP], self._v[STATES:KNOWN]])
        self._arrival = now + to @ step, to @ covariance @ to.T * np.outer(fade, fade)
        self._v = np.concatenate([now, self._v[n:], np.zeros(HOP)])
        self._samples = self._samples.part(HOP, len(self._samples.q))

    def known(self) -> Known:
        """What is known now."""
        return of_logarithms(self._v[STATES:KNOWN], self._covariance[STATES:, STATES:])
