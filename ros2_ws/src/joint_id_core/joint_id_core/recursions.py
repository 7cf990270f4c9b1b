"""The loops over time around one compiled RK4 step.

This module is never called: `codegen` puts its text behind the generated `step` of a model and compiles
both together, which is why `step`, `constants` and the sizes are only declared here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

NX: int  # states
NU: int  # inputs
NP: int  # parameters with sensitivities
NC: int  # parameter-only constants
step: Callable[..., None]
constants: Callable[..., None]


# --- compiled from here ---


def rollout(x0: Any, time: Any, u: Any, p: Any, substeps: int, X: Any) -> None:
    """Simulate from x0; X (T, NX) receives the states."""
    c = np.empty(NC)
    constants(p, c)
    x = x0.copy()
    W = np.empty((NX, 1))
    X[0] = x
    for t in range(len(time) - 1):
        step(x, W, W, W, 0, 0, u[t], u[t + 1], c, time[t + 1] - time[t], substeps)
        X[t + 1] = x


def rollout_sensitivities(x0: Any, time: Any, u: Any, p: Any, substeps: int, X: Any, Sx: Any, Sp: Any) -> None:
    """Simulate from x0 with the derivatives of all states by x0, Sx (T, NX, NX), and by p, Sp (T, NX, NP)."""
    c = np.empty(NC)
    constants(p, c)
    x = x0.copy()
    columns = NX + NU + NP
    W = np.zeros((NX, columns))
    D = np.empty((NX, columns))
    Q = np.empty((NX, columns))
    for i in range(NX):
        W[i, i] = 1.0
    X[0] = x
    Sx[0] = W[:, :NX]
    Sp[0] = 0.0
    for t in range(len(time) - 1):
        step(x, W, D, Q, columns, NP, u[t], u[t + 1], c, time[t + 1] - time[t], substeps)
        X[t + 1] = x
        Sx[t + 1] = W[:, :NX]
        Sp[t + 1] = W[:, NX + NU :]


# --- compiled with smooth friction only: a filter needs derivatives ---


def innovations(
    x0: Any,
    P0: Any,
    begin: Any,
    X0: Any,
    V0: Any,
    time: Any,
    u: Any,
    y: Any,
    label: Any,
    gap: Any,
    R: Any,
    q: Any,
    Q_x: Any,
    p: Any,
    substeps: int,
    n_params: int,
    X: Any,
    e: Any,
    S: Any,
    J: Any,
    K: Any,
    F: Any,
) -> float:
    """Run the innovations form once over the record and return sum e^2/S + log S.

    x0 (NX), P0 (NX, NX): start and its covariance. begin (T): row of X0, V0 (B, NX), the state and its variances with
    which the record begins anew at this sample, or -1. y (T, NY): labels, NaN where missing; label (NY): their
    state; R (NY): their noise variance. q (NU): variance of the input noise, per sample. Q_x (NX): small
    variance added to the states per sample. gap (T): missing samples before the next one; over a gap the
    held input is uncertain by as much as it is seen to change.
    n_params: NP, or 0 to leave the sensitivities out.
    Receives X (T, NX) filtered states, e, S (T, NY) innovations and their variance (0, 1 where missing)
    and J (T, NY, NP) the derivative of the predicted label by the parameters, divided by sqrt(S); K (T, NY, NX)
    gains and F (T, NX, NX + NU) derivatives of the next state by state and input, as `noise_score` needs them.
    """
    c = np.empty(NC)
    constants(p, c)
    columns = NX + NU + n_params
    W = np.zeros((NX, NX + NU + NP))
    D = np.empty((NX, NX + NU + NP))
    Q = np.empty((NX, NX + NU + NP))
    q_t = np.empty(NU)
    M = np.empty((NX, NX))
    x = x0.copy()
    P = P0.copy()
    T = len(time)
    cost = 0.0
    first = NX + NU
    for t in range(T):
        if begin[t] >= 0:
            for m in range(NX):
                x[m] = X0[begin[t], m]
                for n in range(NX):
                    P[m, n] = 0.0
                P[m, m] = V0[begin[t], m]
                for j in range(n_params):
                    W[m, first + j] = 0.0
        for k in range(len(label)):
            i = label[k]
            if math.isnan(y[t, k]):
                e[t, k] = 0.0
                S[t, k] = 1.0
                for j in range(n_params):
                    J[t, k, j] = 0.0
                for m in range(NX):
                    K[t, k, m] = 0.0
                continue
            error = y[t, k] - x[i]
            variance = P[i, i] + R[k]
            cost += error * error / variance + math.log(variance)
            e[t, k] = error
            S[t, k] = variance
            root = 1.0 / math.sqrt(variance)
            for j in range(n_params):
                J[t, k, j] = W[i, first + j] * root
            for m in range(NX):
                K[t, k, m] = P[m, i] / variance
            for m in range(NX):
                x[m] += K[t, k, m] * error
                if m != i:
                    for j in range(n_params):
                        W[m, first + j] -= K[t, k, m] * W[i, first + j]
            for j in range(n_params):
                W[i, first + j] *= R[k] / variance  # 1 - K_i without cancellation
            for m in range(NX):
                for n in range(NX):
                    if m != i and n != i:
                        P[m, n] -= K[t, k, m] * P[i, n]
            for n in range(NX):
                if n != i:
                    P[i, n] *= R[k] / variance
                    P[n, i] = P[i, n]
            P[i, i] *= R[k] / variance
        X[t] = x
        if t == T - 1:
            break
        if begin[t + 1] >= 0:
            for m in range(NX):
                for n in range(NX + NU):
                    F[t, m, n] = 0.0
            continue
        for m in range(NX):
            for n in range(NX + NU):
                W[m, n] = 0.0
            W[m, m] = 1.0
        step(x, W, D, Q, columns, n_params, u[t], u[t + 1], c, time[t + 1] - time[t], substeps)
        for k in range(NU):
            q_t[k] = q[k] + gap[t] * (u[t + 1, k] - u[t, k]) ** 2
        for m in range(NX):
            for n in range(NX):
                total = 0.0
                for k in range(NX):
                    total += W[m, k] * P[k, n]
                M[m, n] = total
        for m in range(NX):
            for n in range(m + 1):
                total = 0.0
                for k in range(NX):
                    total += M[m, k] * W[n, k]
                for k in range(NU):
                    total += W[m, NX + k] * q_t[k] * W[n, NX + k]
                P[m, n] = total
                P[n, m] = total
            P[m, m] += Q_x[m]
            for n in range(NX + NU):
                F[t, m, n] = W[m, n]
    return cost


def noise_score(y: Any, label: Any, e: Any, S: Any, K: Any, F: Any, score_R: Any, score_q: Any) -> None:
    """Derivative of the cost of `innovations` by R (NY) and q (NU), from what that pass stored.

    Exact score of a linear state-space model by the backward recursion of Koopman & Shephard, Biometrika 79
    (1992); the dependence of the linearisation on the noise levels is left out.
    """
    r = np.zeros(NX)
    N = np.zeros((NX, NX))
    M = np.empty((NX, NX))
    v = np.empty(NX)
    score_R[:] = 0.0
    score_q[:] = 0.0
    for t in range(len(y) - 1, -1, -1):
        if t < len(y) - 1:
            for k in range(NU):
                along = 0.0
                spread = 0.0
                for m in range(NX):
                    g = F[t, m, NX + k]
                    along += g * r[m]
                    for n in range(NX):
                        spread += g * N[m, n] * F[t, n, NX + k]
                score_q[k] -= along * along - spread
            for m in range(NX):
                v[m] = 0.0
                for n in range(NX):
                    v[m] += F[t, n, m] * r[n]
                    M[m, n] = 0.0
                    for k in range(NX):
                        M[m, n] += N[m, k] * F[t, k, n]
            for m in range(NX):
                r[m] = v[m]
                for n in range(NX):
                    N[m, n] = 0.0
                    for k in range(NX):
                        N[m, n] += F[t, k, m] * M[k, n]
        for k in range(len(label) - 1, -1, -1):
            if math.isnan(y[t, k]):
                continue
            i = label[k]
            u = e[t, k] / S[t, k]
            D = 1.0 / S[t, k]
            for m in range(NX):
                u -= K[t, k, m] * r[m]
                v[m] = 0.0
                for n in range(NX):
                    v[m] += N[m, n] * K[t, k, n]
            for m in range(NX):
                D += K[t, k, m] * v[m]
            score_R[k] -= u * u - D
            r[i] += u
            for m in range(NX):
                N[m, i] -= v[m]
            for n in range(NX):
                N[i, n] -= v[n]
            N[i, i] += D
