"""The filter of `loops.innovations` for samples that arrive: state and sensitivities are kept from call to call.

It is compiled like `loops.innovations`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from joint_id_core.cell.loops.arrays import Cube, Indices, Matrix, Vector
from joint_id_core.cell.loops.information import of_free
from joint_id_core.cell.loops.innovations import correct, predict, restart, totals

NX: int
NU: int
NP: int
NC: int
CF: int
SF: int
AT_P: int
DELAYED: bool
constants: Callable[..., None]
step: Callable[..., None]


def track(
    kept: Matrix,
    time: Vector,
    u: Matrix,
    y: Matrix,
    label: Indices,
    gap: Vector,
    R: Vector,
    q: Vector,
    Q_x: Vector,
    p: Vector,
    substeps: int,
    stiff: Vector,
    many: int,
    turning: Vector,
    most: int,
    first: int,
    count: int,
    columns: Indices,
    slope: Vector,
    z: Vector,
    e: Matrix,
    S: Matrix,
    K: Cube,
    F: Cube,
    C: Cube,
    J: Cube,
    g: Vector,
    matrix: Matrix,
    vector: Vector,
    white: Matrix,
    largest: Vector,
) -> float:
    """Run the filter over new samples and return their share of the cost; NaN if the path diverges.

    A plain step looks one sample ahead. Where a velocity is so small that smoothed friction makes the cell stiff, or
    may cross zero, the sample takes `many` integrator steps, and more where it crosses zero fast.

    Inputs as in `innovations`, and:
        kept (NX, 1 + NX + NP): filtered state, its covariance and its derivatives by the parameters; updated.
        stiff (NX): speed below which friction makes the cell stiff; negative for states without friction.
        turning (NX), most: change in one step of a velocity with friction that crosses zero, and the most steps of a
            sample for that.
        first, count: row of the sample before, whose labels were used, and number of new samples, which follow it.
        columns (k), slope (k), z (k): as in `information.of_free`.

    Outputs, in the rows of the new samples:
        e, S (rows, NY): as in `innovations`.
        K, F, C, J: as in `innovations`, for `noise_information`; not stored if they have only one row.
        g (NP): score of the new samples, as in `innovations`.
        matrix (k, k), vector (k), white (rows, NY): as of `information.of_free`.
        largest (1): innovation over its standard deviation, in this call or before.
    """
    c = np.empty(NC)
    constants(p, c)
    V = np.zeros(SF)
    x, ahead = np.empty(NX), np.empty(NX)
    stored = len(K) > 1
    restart(x, V, Q_x)
    for m in range(NX):
        x[m] = kept[m, 0]
        for n in range(NX):
            V[AT_P + m * NX + n] = kept[m, 1 + n]
        for j in range(NP):
            V[m * CF + j] = kept[m, 1 + NX + j]
    cost = 0.0
    for t in range(first, first + count):
        h, steps = time[t + 1] - time[t], substeps
        for m in range(NX):
            ahead[m] = x[m]
        step(ahead, ahead, u[t], u[t + 1], c, h, substeps)
        for m in range(NX):
            change = abs(ahead[m] - x[m])
            if stiff[m] >= 0.0 and not abs(x[m]) >= stiff[m] + 2.0 * change:
                steps = max(steps, many)
                if x[m] * ahead[m] < 0.0:
                    steps = max(steps, int(min(most, change / turning[m])))
        predict(x, V, u[t], u[t + 1], c, h, steps, gap[t], q, Q_x)
        if stored:
            for m in range(NX):
                for n in range(NX + NU):
                    F[t, m, n] = V[m * CF + NP + n]
        row = t + 1 if stored else 0
        cost += correct(
            x, V, R, y[t + 1], label, u[t], u[t + 1], c, e[t + 1], S[t + 1], K[row], C[row if DELAYED else 0], J[row]
        )
        if not cost < math.inf:
            return math.nan
    for m in range(NX):
        kept[m, 0] = x[m]
        for n in range(NX):
            kept[m, 1 + n] = V[AT_P + m * NX + n]
        for j in range(NP):
            kept[m, 1 + NX + j] = V[m * CF + j]
    H = np.empty((NP, NP))
    totals(V, H, g)
    largest[0] = max(largest[0], of_free(H, g, columns, slope, z, first, count, e, S, y, matrix, vector, white))
    return cost
