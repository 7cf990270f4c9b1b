"""Functions that use the gains stored by a pass of `loops.innovations`: noise levels, and responses to disturbances.

They are compiled like `loops.simulate`, once for all models with as many states and inputs.
"""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.cell.loops.arrays import Cube, Indices, Matrix, Vector

NX: int  # states
NU: int  # inputs
CL: int  # columns of the derivatives by noise levels
CD: int  # number of disturbances whose responses are computed at once: DISTURBANCES
DELAYED: bool  # whether sensors have delays


DISTURBANCES = 19


def noise_information(
    y: Matrix,
    label: Indices,
    begin: Indices,
    e: Matrix,
    S: Matrix,
    K: Cube,
    F: Cube,
    C: Cube,
    J: Cube,
    score: Vector,
    info: Matrix,
    cross: Matrix,
) -> None:
    """Compute score and information of the noise levels (R, then q) from the arrays that `innovations` stored.

    score (L), with L = NY + NU, is minus half the derivative of the cost by the levels. info (L, L) is the matrix
    sum dS dS' / (2 S^2) + de de' / S (Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989,
    section 3.4.5). cross (NP, L) is the same of parameters and levels, - sum s de' / sqrt(S): how much the score of the
    parameters falls with the levels. The derivatives are propagated forward with the filter; the derivative of the
    linearisation is neglected.
    """
    # One array, as in the steps: derivatives of P, of A P, of x, of column i of P, of S and e, then the three results.
    NY, NP = len(label), J.shape[2]
    P, M, x, P_i = 0, NX * NX * CL, 2 * NX * NX * CL, (2 * NX * NX + NX) * CL
    S_, e_, sums, products = P_i + NX * CL, P_i + (NX + 1) * CL, P_i + (NX + 2) * CL, P_i + (NX + 3) * CL
    cross_ = products + CL * CL
    d = np.zeros((2 * NX * NX + 2 * NX + 3 + CL + NP) * CL)
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
            root = math.sqrt(w)
            for b in range(NP):
                row = J[t, k, b] * root
                for a in range(CL):
                    d[cross_ + b * CL + a] -= row * d[e_ + a]
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
        for b in range(NP):
            cross[b, a] = d[cross_ + b * CL + a]


def bounded_step(
    score: Vector,
    info: Matrix,
    levels: Vector,
    lower: Vector,
    upper: Vector,
    largest: float,
    ridge: float,
    step: Vector,
) -> float:
    """Compute one scoring step of the logarithms of the noise levels, `step` (L); return its squared length by `info`.

    score (L), info (L, L): from `noise_information`, by the logarithms. No level leaves its bounds `lower`, `upper` (L)
    or changes by more than a factor `largest`. A level that would do so is set to its limit, and the step of the others
    is computed with this level held.
    """
    L = len(levels)
    A, change, held = np.empty((L, L)), np.zeros(L), np.zeros(L)
    for _ in range(L + 1):
        for i in range(L):
            step[i] = change[i] if held[i] > 0.0 else score[i]
            for j in range(L):
                A[i, j] = 0.0 if held[i] > 0.0 else info[i, j]
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
            square += step[i] * info[i, j] * step[j]
    return square


def disturbances(
    y: Matrix,
    label: Indices,
    begin: Indices,
    e: Matrix,
    S: Matrix,
    K: Cube,
    F: Cube,
    C: Cube,
    J: Cube,
    channel: Indices,
    disturbance: Matrix,
    cross: Matrix,
    total: Matrix,
    score: Vector,
) -> None:
    """Compute information matrices and score of small disturbances of inputs, with the gains held constant.

    disturbance (T, CD) is added to the inputs `channel` (CD). Let d be the response of a predicted label over sqrt(S),
    and s its row of J. Then cross (NP, CD) = sum s d', total (CD, CD) = sum d d', score (CD) = sum d e / sqrt(S).
    """
    # One array, as in the steps: change of the state, its next value, response of a label, and the sums.
    NP = J.shape[2]
    new, shown, score_, total_, cross_ = (
        NX * CD,
        2 * NX * CD,
        (2 * NX + 1) * CD,
        (2 * NX + 2) * CD,
        (2 * NX + 2 + CD) * CD,
    )
    d = np.zeros((2 * NX + 2 + CD + NP) * CD)
    for t in range(len(y)):
        if begin[t] >= 0:
            for j in range(NX * CD):
                d[j] = 0.0
        for k in range(len(label)):
            if math.isnan(y[t, k]):
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
            for m in range(NX):
                gain = K[t, k, m]
                for j in range(CD):
                    d[m * CD + j] -= gain * d[shown + j]
            error = e[t, k] * root
            for j in range(CD):
                d[shown + j] *= root
                d[score_ + j] += error * d[shown + j]
            for n in range(CD):
                row = d[shown + n]
                for j in range(CD):
                    d[total_ + n * CD + j] += row * d[shown + j]
            for n in range(NP):
                row = J[t, k, n]
                for j in range(CD):
                    d[cross_ + n * CD + j] += row * d[shown + j]
        for m in range(NX):
            for j in range(CD):
                d[new + m * CD + j] = F[t, m, NX + channel[j]] * disturbance[t, j]
            for n in range(NX):
                slope = F[t, m, n]
                for j in range(CD):
                    d[new + m * CD + j] += slope * d[n * CD + j]
        for j in range(NX * CD):
            d[j] = d[new + j]
    for j in range(CD):
        score[j] = d[score_ + j]
        for n in range(CD):
            total[n, j] = d[total_ + n * CD + j]
        for n in range(NP):
            cross[n, j] = d[cross_ + n * CD + j]
