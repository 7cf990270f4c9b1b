"""Loop over time of the innovations form: the filter with its sensitivities.

It is compiled like `loops.simulate`, with the same work space V, but only with smooth friction: a filter needs
derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from joint_id_core.cell.loops.arrays import Cube, Indices, Matrix, Vector
from joint_id_core.cell.loops.simulate import ALIGN, padded

NX: int  # states
NW: int  # rows of the work space V
NU: int  # inputs
NP: int  # parameters with sensitivities
NC: int  # parameter-only constants
CP: int  # columns of the work space of `step_parameters`
CF: int  # columns of the work space of `step_full`
SF: int  # size of the work space of `innovations`
AT_P: int  # offsets of its parts: see `layout`
AT_M: int
AT_s: int
AT_g: int
AT_H: int
DELAYED: bool  # whether sensors have delays
constants: Callable[..., None]
observe: Callable[..., None]
step_full: Callable[..., None]


def layout(states: int, parameters: int, columns: int, step: int) -> dict[str, int]:
    """Return the offsets of the parts of the work space of `innovations`, and its size SF.

    The first `step` numbers are the work space of the step. Then come the covariance P and M = A P, and then, in rows
    of `columns` numbers, the derivatives s of a sample's labels over sqrt(S), the gradient g and the matrix H.
    """
    square = padded(states * states)  # every part begins at the start of a cache line
    sizes = {"AT_M": square, "AT_s": square, "AT_g": states * columns, "AT_H": columns, "SF": parameters * columns}
    found = {"AT_P": step}
    for name, size in sizes.items():
        found[name] = step = step + size
    return found


def innovations(
    x0: Vector,
    P0: Matrix,
    begin: Indices,
    X0: Matrix,
    V0: Matrix,
    time: Vector,
    u: Matrix,
    y: Matrix,
    label: Indices,
    gap: Vector,
    R: Vector,
    q: Vector,
    Q_x: Vector,
    p: Vector,
    substeps: Indices,
    X: Matrix,
    e: Matrix,
    S: Matrix,
    K: Cube,
    F: Cube,
    C: Cube,
    J: Cube,
    H: Matrix,
    g: Vector,
) -> float:
    """Run the innovations form once over the record and return sum e^2/S + log S; NaN if the path diverges.

    The derivatives s of the predicted labels by the parameters, over sqrt(S), are computed with the gain held constant.

    Inputs:
        x0 (NX), P0 (NX, NX): start state and its covariance.
        begin (T): row of X0 and V0 (B, NX), the state and its variances with which the record restarts at this sample;
            -1 for no restart.
        time (T), u (T, NU): instants in s and inputs.
        y (T, NY), label (NY): labels, NaN where missing, and the index of their states.
        gap (T): missing samples before the next one. Over a gap the held input is uncertain by its observed change.
        R (NY), q (NU): variances of label noise and of input noise per sample.
        Q_x (NX): small variance added to the states per sample.
        p: all parameters.
        substeps (T): integrator steps to the next sample.

    Outputs:
        X (T, NX): filtered states.
        e, S (T, NY): innovations and their variances; 0 and 1 where a label is missing.
        K (T, NY, NX): gains.
        F (T, NX, NX + NU): derivatives of the next state by state and input, for `noise_information`.
        C (T, NY, NX): derivatives of the predicted labels by the state, only if sensors have delays.
        J (T, NY, NP): the derivatives s.
        H (NP, NP), g (NP): sum s s' and sum s e / sqrt(S).
    """
    c = np.empty(NC)
    constants(p, c)
    # One array (see `layout`): the columns of the step, P, A P, rows s of this sample's labels, sum s e, sum s s'.
    V = np.zeros(SF)
    x, shown, at, seen = np.empty(NX), np.empty(NX), np.empty(NX), np.empty(NX)
    by_x, by_p = np.empty((NX, NX)), np.empty((NX, max(NP, 1)))
    for m in range(NX):
        x[m] = x0[m]
        for n in range(NX):
            V[AT_P + m * NX + n] = P0[m, n]
    T = len(time)
    cost = 0.0
    for t in range(T):
        if begin[t] >= 0:
            for m in range(NX):
                x[m] = X0[begin[t], m]
                for n in range(NX):
                    V[AT_P + m * NX + n] = 0.0
                V[AT_P + m * NX + m] = V0[begin[t], m]
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
                    V[AT_s + k * CP + j] = 0.0
                for j in range(NP):
                    J[t, k, j] = 0.0
                for m in range(NX):
                    K[t, k, m] = 0.0
                continue
            error = y[t, k] - x[i]
            variance = V[AT_P + i * NX + i] + R[k]
            if DELAYED:
                error = y[t, k] - shown[i]
                variance = R[k]
                for m in range(NX):
                    error -= by_x[i, m] * (x[m] - at[m])
                    seen[m] = 0.0
                    for n in range(NX):
                        seen[m] += V[AT_P + m * NX + n] * by_x[i, n]
                    variance += by_x[i, m] * seen[m]
            if not variance > 0.0:  # the path diverged
                return math.nan
            inverse = 1.0 / variance
            root = math.sqrt(inverse)
            white = error * root
            cost += white * white
            volume *= variance
            e[t, k] = error
            S[t, k] = variance
            for j in range(CP):
                V[AT_s + k * CP + j] = V[i * CF + j] * root
            if DELAYED:
                for j in range(NP):
                    V[AT_s + k * CP + j] = by_p[i, j] * root
                    for m in range(NX):
                        V[AT_s + k * CP + j] += by_x[i, m] * V[m * CF + j] * root
            for j in range(NP):
                J[t, k, j] = V[AT_s + k * CP + j]
            for j in range(CP):
                V[AT_g + j] += V[AT_s + k * CP + j] * white
            for m in range(NX):
                gain = (seen[m] if DELAYED else V[AT_P + m * NX + i]) * inverse
                K[t, k, m] = gain
                x[m] += gain * error
                gain *= variance * root
                for j in range(CP):
                    V[m * CF + j] -= gain * V[AT_s + k * CP + j]
            if DELAYED:
                for m in range(NX):
                    for n in range(NX):
                        V[AT_P + m * NX + n] -= 0.5 * (K[t, k, m] * seen[n] + K[t, k, n] * seen[m])
                continue
            for m in range(NX):
                if m != i:
                    for n in range(NX):
                        if n != i:
                            V[AT_P + m * NX + n] -= K[t, k, m] * V[AT_P + i * NX + n]
            # P (1 - K) with 1 - K = R / S: the difference 1 - K itself would lose its digits
            left = R[k] * inverse
            for n in range(NX):
                V[AT_P + i * NX + n] *= left
            for n in range(NX):
                V[AT_P + n * NX + i] = V[AT_P + i * NX + n]
        cost += math.log(volume)
        for k in range(len(label)):  # the lower triangle of H, in blocks of the width of a cache line
            for b in range(CP // ALIGN):
                for j in range(b * ALIGN, NP):
                    row = V[AT_s + k * CP + j]
                    for n in range(b * ALIGN, (b + 1) * ALIGN):
                        V[AT_H + j * CP + n] += row * V[AT_s + k * CP + n]
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
                    total += V[m * CF + NP + k] * V[AT_P + k * NX + n]
                V[AT_M + m * NX + n] = total
        for m in range(NX):
            for n in range(m + 1):
                total = 0.0
                for k in range(NX):
                    total += V[AT_M + m * NX + k] * V[n * CF + NP + k]
                V[AT_P + m * NX + n] = total
        for k in range(NU):
            variance = q[k] + gap[t] * (u[t + 1, k] - u[t, k]) ** 2
            for m in range(NX):
                for n in range(m + 1):
                    V[AT_P + m * NX + n] += V[m * CF + NP + NX + k] * variance * V[n * CF + NP + NX + k]
        for m in range(NX):
            V[AT_P + m * NX + m] += Q_x[m]
            for n in range(m):
                V[AT_P + n * NX + m] = V[AT_P + m * NX + n]
    for j in range(NP):
        g[j] = V[AT_g + j]
        for n in range(j + 1):
            H[j, n] = V[AT_H + j * CP + n]
            H[n, j] = H[j, n]
    return cost


def observations(X: Matrix, u: Matrix, p: Vector, Y: Matrix) -> None:
    """Fill Y (T, NX) with the sensor readings of all states along the path X (T, NX)."""
    c = np.empty(NC)
    constants(p, c)
    by_x, by_p = np.empty((NX, NX)), np.empty((NX, max(NP, 1)))
    for t in range(len(X)):
        for i in range(NX):
            Y[t, i] = X[t, i]
        if DELAYED:
            observe(X[t], u[max(t - 1, 0)], u[t], c, Y[t], by_x, by_p)
