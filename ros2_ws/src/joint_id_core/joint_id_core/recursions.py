"""The loops over time around one compiled RK4 step.

This module is never called: `codegen` puts its text behind the generated functions of a model and compiles
both together, which is why those and the sizes are only declared here. The work space V of the sensitivities is one
array of rows, `columns` apart: NX rows W of derivatives of the state, then the step's own. Its columns are the
derivatives by the NP parameters, in `step_full` then by the NX states at the start of the sample and the NU inputs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

NX: int  # states
NW: int  # rows of the work space V
NU: int  # inputs
NP: int  # parameters with sensitivities
NC: int  # parameter-only constants
CP: int  # columns of the work space of `step_parameters`
CF: int  # columns of the work space of `step_full`
CL: int  # columns of the derivatives by noise levels
CD: int  # disturbances whose responses are computed at once
DELAYED: bool  # whether sensors show the states late
constants: Callable[..., None]
jacobian: Callable[..., None]
observe: Callable[..., None]
step: Callable[..., None]
step_parameters: Callable[..., None]
step_full: Callable[..., None]


# --- compiled from here ---


def rollout(X0: Any, block: int, time: Any, u: Any, p: Any, substeps: Any, X: Any) -> None:
    """Simulate, begun anew every `block` samples from the next row of X0 (B, NX).

    substeps (T): steps from each sample to the next. X (T, NX) receives the states; where a run begins anew, those
    at the end of the one before.
    """
    c = np.empty(NC)
    constants(p, c)
    x = X0[0].copy()
    for t in range(len(time)):
        X[t] = x
        if t % block == 0:
            x[:] = X0[t // block]
        if t < len(time) - 1:
            step(x, x, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t])


def rollout_sensitivities(x0: Any, time: Any, u: Any, p: Any, substeps: Any, X: Any, J: Any) -> None:
    """Simulate from x0 with the derivatives of all states by p, J (T, NX, NP)."""
    c = np.empty(NC)
    constants(p, c)
    x = x0.copy()
    V = np.zeros(NW * CP)
    for t in range(len(time)):
        for i in range(NX):
            X[t, i] = x[i]
            for j in range(NP):
                J[t, i, j] = V[i * CP + j]
        if t < len(time) - 1:
            step_parameters(x, V, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t])


def jacobians(X: Any, u: Any, p: Any, A: Any) -> None:
    """df/dx at every row of X (T, NX), u (T, NU), into A (T, NX, NX)."""
    c = np.empty(NC)
    constants(p, c)
    for t in range(len(X)):
        jacobian(X[t], u[t], c, A[t])


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
    substeps: Any,
    X: Any,
    e: Any,
    S: Any,
    K: Any,
    F: Any,
    C: Any,
    J: Any,
    H: Any,
    g: Any,
) -> float:
    """Run the innovations form once over the record and return sum e^2/S + log S, NaN if the path blew up.

    x0 (NX), P0 (NX, NX): start and its covariance. begin (T): row of X0, V0 (B, NX), the state and its variances with
    which the record begins anew at this sample, or -1. y (T, NY): labels, NaN where missing; label (NY): their
    state; R (NY): their noise variance. q (NU): variance of the input noise, per sample. Q_x (NX): small
    variance added to the states per sample. gap (T): missing samples before the next one; over a gap the
    held input is uncertain by as much as it is seen to change. substeps (T): RK4 steps to the next sample.
    Receives X (T, NX) filtered states, e, S (T, NY) innovations and their variance (0, 1 where missing), K (T, NY, NX)
    gains, F (T, NX, NX + NU) derivatives of the next state by state and input and, where sensors are late, C (T, NY,
    NX) those of the predicted labels by the state, as `noise_information` needs them;
    J (T, NY, NP) derivatives of the predicted labels by the parameters over sqrt(S), the gain held;
    H (NP, NP) = sum s s' and g (NP) = sum s e / sqrt(S) with s the derivative of the predicted label by the parameters
    over sqrt(S), the gain held.
    """
    c = np.empty(NC)
    constants(p, c)
    # One array (see the module): the columns of the step, P, A P, rows s of this sample's labels, sum s e, sum s s'.
    P, M = NW * CF, NW * CF + NX * NX
    s, gradient = M + NX * NX, M + NX * NX + NX * CP
    hessian = gradient + CP
    V = np.zeros(hessian + NP * CP)
    x = x0.copy()
    shown, at, seen = np.empty(NX), np.empty(NX), np.empty(NX)
    by_x, by_p = np.empty((NX, NX)), np.empty((NX, max(NP, 1)))
    for m in range(NX):
        for n in range(NX):
            V[P + m * NX + n] = P0[m, n]
    T = len(time)
    cost = 0.0
    for t in range(T):
        if begin[t] >= 0:
            for m in range(NX):
                x[m] = X0[begin[t], m]
                for n in range(NX):
                    V[P + m * NX + n] = 0.0
                V[P + m * NX + m] = V0[begin[t], m]
                for j in range(NP):
                    V[m * CF + j] = 0.0
        volume = 1.0
        if DELAYED:
            observe(x, u[t if t == 0 or begin[t] >= 0 else t - 1], u[t], c, shown, by_x, by_p)
            for m in range(NX):
                at[m] = x[m]
        for k in range(len(label)):
            i = label[k]
            if DELAYED:
                for m in range(NX):
                    C[t, k, m] = by_x[i, m]
            if math.isnan(y[t, k]):
                e[t, k] = 0.0
                S[t, k] = 1.0
                for j in range(CP):
                    V[s + k * CP + j] = 0.0
                for j in range(NP):
                    J[t, k, j] = 0.0
                for m in range(NX):
                    K[t, k, m] = 0.0
                continue
            error = y[t, k] - x[i]
            variance = V[P + i * NX + i] + R[k]
            if DELAYED:
                error = y[t, k] - shown[i]
                variance = R[k]
                for m in range(NX):
                    error -= by_x[i, m] * (x[m] - at[m])
                    seen[m] = 0.0
                    for n in range(NX):
                        seen[m] += V[P + m * NX + n] * by_x[i, n]
                    variance += by_x[i, m] * seen[m]
            if not variance > 0.0:  # the path blew up
                return math.nan
            inverse = 1.0 / variance
            root = math.sqrt(inverse)
            white = error * root
            cost += white * white
            volume *= variance
            e[t, k] = error
            S[t, k] = variance
            for j in range(CP):
                V[s + k * CP + j] = V[i * CF + j] * root
            if DELAYED:
                for j in range(NP):
                    V[s + k * CP + j] = by_p[i, j] * root
                    for m in range(NX):
                        V[s + k * CP + j] += by_x[i, m] * V[m * CF + j] * root
            for j in range(NP):
                J[t, k, j] = V[s + k * CP + j]
            for j in range(CP):
                V[gradient + j] += V[s + k * CP + j] * white
            for m in range(NX):
                gain = (seen[m] if DELAYED else V[P + m * NX + i]) * inverse
                K[t, k, m] = gain
                x[m] += gain * error
                gain *= variance * root
                for j in range(CP):
                    V[m * CF + j] -= gain * V[s + k * CP + j]
            if DELAYED:
                for m in range(NX):
                    for n in range(NX):
                        V[P + m * NX + n] -= 0.5 * (K[t, k, m] * seen[n] + K[t, k, n] * seen[m])
                continue
            for m in range(NX):
                if m != i:
                    for n in range(NX):
                        if n != i:
                            V[P + m * NX + n] -= K[t, k, m] * V[P + i * NX + n]
            # P (1 - K) with 1 - K = R / S: a difference of nearly equal numbers would lose it
            left = R[k] * inverse
            for n in range(NX):
                V[P + i * NX + n] *= left
            for n in range(NX):
                V[P + n * NX + i] = V[P + i * NX + n]
        cost += math.log(volume)
        for k in range(len(label)):
            for j in range(NP):
                row = V[s + k * CP + j]
                for n in range(CP):
                    V[hessian + j * CP + n] += row * V[s + k * CP + n]
        for m in range(NX):
            X[t, m] = x[m]
        if t == T - 1:
            break
        if begin[t + 1] >= 0:
            for m in range(NX):
                for n in range(NX + NU):
                    F[t, m, n] = 0.0
            continue
        for m in range(NX):
            for n in range(NX + NU):
                V[m * CF + NP + n] = 0.0
            V[m * CF + NP + m] = 1.0
        step_full(x, V, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t])
        for m in range(NX):
            for n in range(NX + NU):
                F[t, m, n] = V[m * CF + NP + n]
            for n in range(NX):
                total = 0.0
                for k in range(NX):
                    total += V[m * CF + NP + k] * V[P + k * NX + n]
                V[M + m * NX + n] = total
        for m in range(NX):
            for n in range(m + 1):
                total = 0.0
                for k in range(NX):
                    total += V[M + m * NX + k] * V[n * CF + NP + k]
                V[P + m * NX + n] = total
        for k in range(NU):
            variance = q[k] + gap[t] * (u[t + 1, k] - u[t, k]) ** 2
            for m in range(NX):
                for n in range(m + 1):
                    V[P + m * NX + n] += V[m * CF + NP + NX + k] * variance * V[n * CF + NP + NX + k]
        for m in range(NX):
            V[P + m * NX + m] += Q_x[m]
            for n in range(m):
                V[P + n * NX + m] = V[P + m * NX + n]
    for j in range(NP):
        g[j] = V[gradient + j]
        for n in range(NP):
            H[j, n] = V[hessian + j * CP + n]
    return cost


def noise_information(
    y: Any, label: Any, begin: Any, e: Any, S: Any, K: Any, F: Any, C: Any, score: Any, info: Any
) -> None:
    """Score and information of the noise levels (R, then q) from what `innovations` stored.

    score (L) is minus half the derivative of its cost by the levels, info (L, L) the matrix
    sum dS dS' / (2 S^2) + de de' / S (Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989,
    section 3.4.5), with L = NY + NU. The derivatives run forward with the filter; that of the linearisation itself
    is left out.
    """
    # One array, as in the steps: derivatives of P, of A P, of x, of column i of P, of S and e, then the two results.
    NY = len(label)
    P, M, x, P_i = 0, NX * NX * CL, 2 * NX * NX * CL, (2 * NX * NX + NX) * CL
    S_, e_, sums, products = P_i + NX * CL, P_i + (NX + 1) * CL, P_i + (NX + 2) * CL, P_i + (NX + 3) * CL
    d = np.zeros((2 * NX * NX + 2 * NX + 3 + CL) * CL)
    for t in range(len(y)):
        if begin[t] >= 0:
            for j in range(NX * NX * CL):
                d[P + j] = 0.0
            for j in range(NX * CL):
                d[x + j] = 0.0
        for k in range(NY):
            if math.isnan(y[t, k]):
                continue
            i = label[k]
            w = 1.0 / S[t, k]
            z = e[t, k] * w
            for m in range(NX):
                for a in range(CL):
                    d[P_i + m * CL + a] = d[P + (m * NX + i) * CL + a]
            for a in range(CL):
                d[S_ + a] = d[P + (i * NX + i) * CL + a]
                d[e_ + a] = -d[x + i * CL + a]
            if DELAYED:
                for a in range(CL):
                    d[S_ + a] = 0.0
                    d[e_ + a] = 0.0
                for m in range(NX):
                    row = C[t, k, m]
                    for a in range(CL):
                        d[P_i + m * CL + a] = 0.0
                    for n in range(NX):
                        other = C[t, k, n]
                        for a in range(CL):
                            d[P_i + m * CL + a] += other * d[P + (m * NX + n) * CL + a]
                    for a in range(CL):
                        d[S_ + a] += row * d[P_i + m * CL + a]
                        d[e_ + a] -= row * d[x + m * CL + a]
            d[S_ + k] += 1.0
            for a in range(CL):
                d[sums + a] += 0.5 * (z * z - w) * d[S_ + a] - z * d[e_ + a]
            for b in range(NY + NU):
                along, level = 0.5 * w * w * d[S_ + b], w * d[e_ + b]
                for a in range(CL):
                    d[products + b * CL + a] += along * d[S_ + a] + level * d[e_ + a]
            for m in range(NX):
                gain = K[t, k, m]
                for a in range(CL):
                    d[x + m * CL + a] += (d[P_i + m * CL + a] - gain * d[S_ + a]) * z + gain * d[e_ + a]
                for n in range(m + 1):
                    other = K[t, k, n]
                    for a in range(CL):
                        change = d[P_i + m * CL + a] * other + gain * (d[P_i + n * CL + a] - other * d[S_ + a])
                        d[P + (m * NX + n) * CL + a] -= change
                        d[P + (n * NX + m) * CL + a] = d[P + (m * NX + n) * CL + a]
        if t == len(y) - 1:
            break
        for m in range(NX):
            for a in range(CL):
                d[P_i + m * CL + a] = 0.0
            for k in range(NX):
                slope = F[t, m, k]
                for a in range(CL):
                    d[P_i + m * CL + a] += slope * d[x + k * CL + a]
            for n in range(NX):
                for a in range(CL):
                    d[M + (m * NX + n) * CL + a] = 0.0
                for k in range(NX):
                    slope = F[t, m, k]
                    for a in range(CL):
                        d[M + (m * NX + n) * CL + a] += slope * d[P + (k * NX + n) * CL + a]
        for j in range(NX * CL):
            d[x + j] = d[P_i + j]
        for m in range(NX):
            for n in range(m + 1):
                for a in range(CL):
                    d[P_i + a] = 0.0
                for k in range(NX):
                    slope = F[t, n, k]
                    for a in range(CL):
                        d[P_i + a] += d[M + (m * NX + k) * CL + a] * slope
                for k in range(NU):
                    d[P_i + NY + k] += F[t, m, NX + k] * F[t, n, NX + k]
                for a in range(CL):
                    d[P + (m * NX + n) * CL + a] = d[P_i + a]
                    d[P + (n * NX + m) * CL + a] = d[P_i + a]
    for a in range(NY + NU):
        score[a] = d[sums + a]
        for b in range(NY + NU):
            info[a, b] = d[products + a * CL + b]


def bounded_step(
    score: Any, info: Any, levels: Any, lower: Any, upper: Any, largest: float, ridge: float, step: Any
) -> float:
    """One scoring step of the logarithms of the noise levels, `step` (L), and its squared length by `info`.

    score (L), info (L, L): of `noise_information`. No level leaves its bounds `lower`, `upper` (L) or changes by more
    than a factor `largest`: one that would is held where it is allowed to go, and the others take their step beside it.
    """
    L = len(levels)
    A, change, held = np.empty((L, L)), np.zeros(L), np.zeros(L)
    for _ in range(L + 1):
        for i in range(L):
            step[i] = change[i] if held[i] > 0.0 else score[i] * levels[i]
            for j in range(L):
                A[i, j] = 0.0 if held[i] > 0.0 else info[i, j] * levels[i] * levels[j]
            A[i, i] = 1.0 if held[i] > 0.0 else A[i, i] + ridge
        for i in range(L):
            for k in range(i + 1, L):
                factor = A[k, i] / A[i, i]
                for j in range(i, L):
                    A[k, j] -= factor * A[i, j]
                step[k] -= factor * step[i]
        for i in range(L - 1, -1, -1):
            for j in range(i + 1, L):
                step[i] -= A[i, j] * step[j]
            step[i] /= A[i, i]
        beyond = 0
        for i in range(L):
            if held[i] > 0.0:
                continue
            least, most = max(1.0 / largest, lower[i] / levels[i]) - 1.0, min(largest, upper[i] / levels[i]) - 1.0
            change[i] = min(max(step[i], least), most)
            if change[i] != step[i]:
                held[i] = 1.0
                beyond += 1
        if beyond == 0:
            break
    square = 0.0
    for i in range(L):
        step[i] = math.log1p(change[i])
    for i in range(L):
        for j in range(L):
            square += step[i] * info[i, j] * levels[i] * levels[j] * step[j]
    return square


def responses(
    y: Any, label: Any, begin: Any, S: Any, K: Any, F: Any, C: Any, channel: Any, disturbance: Any, out: Any
) -> None:
    """How small disturbances of inputs would move the predicted labels, over sqrt(S), with known gains.

    disturbance (T, CD): added to the inputs `channel` (CD); out (T, NY, CD), 0 where a label is missing.
    """
    # One array, as in the steps: the change of the state, the next one, and what a label shows of it.
    new, shown = NX * CD, 2 * NX * CD
    d = np.zeros((2 * NX + 1) * CD)
    for t in range(len(y)):
        if begin[t] >= 0:
            for j in range(NX * CD):
                d[j] = 0.0
        for k in range(len(label)):
            if math.isnan(y[t, k]):
                for j in range(CD):
                    out[t, k, j] = 0.0
                continue
            i = label[k]
            root = 1.0 / math.sqrt(S[t, k])
            for j in range(CD):
                d[shown + j] = d[i * CD + j]
            if DELAYED:
                for j in range(CD):
                    d[shown + j] = 0.0
                for m in range(NX):
                    row = C[t, k, m]
                    for j in range(CD):
                        d[shown + j] += row * d[m * CD + j]
            for j in range(CD):
                out[t, k, j] = d[shown + j] * root
            for m in range(NX):
                gain = K[t, k, m]
                for j in range(CD):
                    d[m * CD + j] -= gain * d[shown + j]
        for m in range(NX):
            for j in range(CD):
                d[new + m * CD + j] = F[t, m, NX + channel[j]] * disturbance[t, j]
            for n in range(NX):
                slope = F[t, m, n]
                for j in range(CD):
                    d[new + m * CD + j] += slope * d[n * CD + j]
        for j in range(NX * CD):
            d[j] = d[new + j]


def observations(X: Any, u: Any, p: Any, Y: Any) -> None:
    """What the sensors of all states show, Y (T, NX), along the path X (T, NX)."""
    c = np.empty(NC)
    constants(p, c)
    by_x, by_p = np.empty((NX, NX)), np.empty((NX, max(NP, 1)))
    for t in range(len(X)):
        Y[t] = X[t]
        if DELAYED:
            observe(X[t], u[max(t - 1, 0)], u[t], c, Y[t], by_x, by_p)
