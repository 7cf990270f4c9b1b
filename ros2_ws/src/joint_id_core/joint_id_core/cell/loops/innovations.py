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
    x = np.empty(NX)
    restart(x, V, x0)
    for m in range(NX):
        for n in range(NX):
            V[AT_P + m * NX + n] = P0[m, n]
    T = len(time)
    cost = 0.0
    for t in range(T):
        if begin[t] >= 0:
            restart(x, V, X0[begin[t]])
            for m in range(NX):
                V[AT_P + m * NX + m] = V0[begin[t], m]
        before = t if t == 0 or begin[t] >= 0 else t - 1
        cost += correct(x, V, R, y[t], label, u[before], u[t], c, e[t], S[t], K[t], C[t if DELAYED else 0], J[t])
        if not cost < math.inf:
            return math.nan
        for m in range(NX):
            X[t, m] = x[m]
        if t == T - 1:
            break
        if begin[t + 1] >= 0:
            for m in range(NX):
                for n in range(NX + NU):
                    F[t, m, n] = 0.0
            continue
        predict(x, V, u[t], u[t + 1], c, time[t + 1] - time[t], substeps[t], gap[t], q, Q_x)
        for m in range(NX):
            for n in range(NX + NU):
                F[t, m, n] = V[m * CF + NP + n]
    totals(V, H, g)
    return cost


def restart(x: Vector, V: Vector, start: Vector) -> None:
    """Set the state to `start`, with P and the derivatives of the state by the parameters at zero."""
    for m in range(NX):
        x[m] = start[m]
        for n in range(NX):
            V[AT_P + m * NX + n] = 0.0
        for j in range(NP):
            V[m * CF + j] = 0.0


def correct(
    x: Vector,
    V: Vector,
    R: Vector,
    y: Vector,
    label: Indices,
    held: Vector,
    u: Vector,
    c: Vector,
    e: Vector,
    S: Vector,
    K: Matrix,
    C: Matrix,
    J: Matrix,
) -> float:
    """Correct the state x, P and the derivatives in V by the labels y of one sample; add to sums s e and s s' in V.

    `held` are the inputs until this sample, u those from now on. For the other arguments see `innovations`: e, S, K, C
    and J are their rows of this sample. Returns the share of the cost; inf if the path diverged.
    """
    shown, at, seen = np.empty(NX), np.empty(NX), np.empty(NX)
    by_x, by_p = np.empty((NX, NX)), np.empty((NX, max(NP, 1)))
    cost = 0.0
    volume = 1.0
    if DELAYED:
        observe(x, held, u, c, shown, by_x, by_p)
        for m in range(NX):
            at[m] = x[m]
    for k in range(len(label)):
        i = label[k]
        if DELAYED:
            for m in range(NX):
                C[k, m] = by_x[i, m]
        if math.isnan(y[k]):
            e[k] = 0.0
            S[k] = 1.0
            for j in range(CP):
                V[AT_s + k * CP + j] = 0.0
            for j in range(NP):
                J[k, j] = 0.0
            for m in range(NX):
                K[k, m] = 0.0
            continue
        error = y[k] - x[i]
        variance = V[AT_P + i * NX + i] + R[k]
        if DELAYED:
            error = y[k] - shown[i]
            variance = R[k]
            for m in range(NX):
                error -= by_x[i, m] * (x[m] - at[m])
                seen[m] = 0.0
                for n in range(NX):
                    seen[m] += V[AT_P + m * NX + n] * by_x[i, n]
                variance += by_x[i, m] * seen[m]
        if not variance > 0.0:
            return math.inf
        inverse = 1.0 / variance
        root = math.sqrt(inverse)
        white = error * root
        cost += white * white
        volume *= variance
        e[k] = error
        S[k] = variance
        for j in range(CP):
            V[AT_s + k * CP + j] = V[i * CF + j] * root
        if DELAYED:
            for j in range(NP):
                V[AT_s + k * CP + j] = by_p[i, j] * root
                for m in range(NX):
                    V[AT_s + k * CP + j] += by_x[i, m] * V[m * CF + j] * root
        for j in range(NP):
            J[k, j] = V[AT_s + k * CP + j]
        for j in range(CP):
            V[AT_g + j] += V[AT_s + k * CP + j] * white
        for m in range(NX):
            gain = (seen[m] if DELAYED else V[AT_P + m * NX + i]) * inverse
            K[k, m] = gain
            x[m] += gain * error
            gain *= variance * root
            for j in range(CP):
                V[m * CF + j] -= gain * V[AT_s + k * CP + j]
        if DELAYED:
            for m in range(NX):
                for n in range(NX):
                    V[AT_P + m * NX + n] -= 0.5 * (K[k, m] * seen[n] + K[k, n] * seen[m])
            continue
        for m in range(NX):
            if m != i:
                for n in range(NX):
                    if n != i:
                        V[AT_P + m * NX + n] -= K[k, m] * V[AT_P + i * NX + n]
        # P (1 - K) with 1 - K = R / S: the difference 1 - K itself would lose its digits
        left = R[k] * inverse
        for n in range(NX):
            V[AT_P + i * NX + n] *= left
        for n in range(NX):
            V[AT_P + n * NX + i] = V[AT_P + i * NX + n]
    for k in range(len(label)):  # the lower triangle of H, in blocks of the width of a cache line
        for b in range(CP // ALIGN):
            for j in range(b * ALIGN, NP):
                row = V[AT_s + k * CP + j]
                for n in range(b * ALIGN, (b + 1) * ALIGN):
                    V[AT_H + j * CP + n] += row * V[AT_s + k * CP + n]
    return cost + math.log(volume)


def predict(
    x: Vector,
    V: Vector,
    u0: Vector,
    u1: Vector,
    c: Vector,
    h: float,
    substeps: int,
    gap: float,
    q: Vector,
    Q_x: Vector,
) -> None:
    """Advance the state x, P and the derivatives in V to the next sample, a time h in s later."""
    for m in range(NX):
        for n in range(NX + NU):
            V[m * CF + NP + n] = 0.0
        V[m * CF + NP + m] = 1.0
    step_full(x, V, u0, u1, c, h, substeps)
    for m in range(NX):
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
        variance = q[k] + gap * (u1[k] - u0[k]) ** 2
        for m in range(NX):
            for n in range(m + 1):
                V[AT_P + m * NX + n] += V[m * CF + NP + NX + k] * variance * V[n * CF + NP + NX + k]
    for m in range(NX):
        V[AT_P + m * NX + m] += Q_x[m]
        for n in range(m):
            V[AT_P + n * NX + m] = V[AT_P + m * NX + n]


def totals(V: Vector, H: Matrix, g: Vector) -> None:
    """Copy the sums s s' to H (NP, NP) and s e / sqrt(S) to g (NP)."""
    for j in range(NP):
        g[j] = V[AT_g + j]
        for n in range(j + 1):
            H[j, n] = V[AT_H + j * CP + n]
            H[n, j] = H[j, n]


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
