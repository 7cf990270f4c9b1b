"""The implicit cell: a singly diagonally implicit Runge-Kutta step instead of RK4, for stiff joints.

The method is ESDIRK of order 4, L-stable and stiffly accurate: the implicit part of ARK4(3)6L[2]SA (Kennedy &
Carpenter, Applied Numerical Mathematics 44, 2003). All its coefficients are below 1, so a reversal of Coulomb friction
within a step causes only a small error. The coefficients of SDIRK4 (Hairer & Wanner, Solving Ordinary Differential
Equations II, table 6.5) reach 8. Modes that decay within a fraction of the step are damped, however fast they are; RK4
is unstable beyond |lambda h| = 2.78. Every stage is solved by Newton's method. The sensitivities are the exact
derivatives of the solved stages: the implicit function theorem gives them with the same matrix.

This is compiled like `loops.simulate`. After the NX rows of W, the work space V has the slopes D of the six stages, and
then the argument of the present stage.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from joint_id_core.cell.loops.arrays import Indices, Matrix, Vector

NX: int
NU: int
NP: int
inputs: Callable[..., None]
slope: Callable[..., None]
jacobian: Callable[..., None]
linearise: Callable[..., None]

GAMMA = 0.25
STAGES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (1 / 4, 1 / 4, 0.0, 0.0, 0.0, 0.0),
    (8611 / 62500, -1743 / 31250, 1 / 4, 0.0, 0.0, 0.0),
    (5012029 / 34652500, -654441 / 2922500, 174375 / 388108, 1 / 4, 0.0, 0.0),
    (15267082809 / 155376265600, -71443401 / 120774400, 730878875 / 902184768, 2285395 / 8070912, 1 / 4, 0.0),
    (82889 / 524892, 0.0, 15625 / 83664, 69875 / 102672, -2260 / 8211, 1 / 4),
)
NODES = (0.0, 1 / 2, 83 / 250, 31 / 50, 17 / 20, 1.0)
NEWTON = 30  # most iterations: a smooth stage takes three, sharp friction may need some with halved steps
HALVINGS = 8  # most halvings of a Newton step
EXACT = 1e-11  # relative change of a slope below which a stage is solved
AS_EXACT_AS_CAN_BE = 1e-7  # below this change, a step that improves nothing is due to rounding and not a failure


def factor(M: Matrix, order: Indices) -> None:
    """Compute the LU decomposition of M (n, n) in place, with partial pivoting: row i of LU is row order[i] of M."""
    size = len(M)
    for i in range(size):
        order[i] = i
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(M[i, k]) > abs(M[best, k]):
                best = i
        if best != k:
            order[k], order[best] = order[best], order[k]
            for j in range(size):
                M[k, j], M[best, j] = M[best, j], M[k, j]
        for i in range(k + 1, size):
            M[i, k] /= M[k, k]
            for j in range(k + 1, size):
                M[i, j] -= M[i, k] * M[k, j]


def solve(M: Matrix, order: Indices, r: Vector, out: Vector) -> None:
    """Solve M out = r with the factors of M; r and out (n) must be different arrays."""
    size = len(M)
    for i in range(size):
        total = r[order[i]]
        for j in range(i):
            total -= M[i, j] * out[j]
        out[i] = total
    for i in range(size - 1, -1, -1):
        total = out[i]
        for j in range(i + 1, size):
            total -= M[i, j] * out[j]
        out[i] = total / M[i, i]


def matrix(y: Vector, hg: float, u: Vector, c: Vector, M: Matrix, order: Indices) -> None:
    """Compute the LU factors of 1 - hg df/dx at y."""
    jacobian(y, u, c, M)
    for i in range(len(M)):
        for j in range(len(M)):
            M[i, j] *= -hg
        M[i, i] += 1.0
    factor(M, order)


def solve_stage(
    y0: Vector, k: Vector, hg: float, u: Vector, c: Vector, space: Matrix, M: Matrix, order: Indices
) -> None:
    """Solve k = f(y0 + hg k) by Newton's method from the given k. space (4, NX) is work space.

    A step that increases the residual is halved: across a reversal of Coulomb friction, full steps may oscillate.
    """
    f, residual, change, y = space[0], space[1], space[2], space[3]
    n = len(k)
    norm = 0.0
    for i in range(n):
        y[i] = y0[i] + hg * k[i]
    slope(y, u, c, f)
    for i in range(n):
        residual[i] = f[i] - k[i]
        norm += residual[i] * residual[i]
    for _ in range(NEWTON):
        matrix(y, hg, u, c, M, order)
        solve(M, order, residual, change)
        worst = 0.0
        for i in range(n):
            worst = max(worst, abs(change[i]) / (abs(k[i]) + abs(change[i]) + abs(y[i]) / hg * 1e-3 + 1e-9))
        before, share = norm, 1.0
        for halving in range(HALVINGS):
            norm = 0.0
            for i in range(n):
                y[i] = y0[i] + hg * (k[i] + share * change[i])
            slope(y, u, c, f)
            for i in range(n):
                residual[i] = f[i] - k[i] - share * change[i]
                norm += residual[i] * residual[i]
            if norm <= before or worst < AS_EXACT_AS_CAN_BE or halving == HALVINGS - 1:
                break
            share *= 0.5
        for i in range(n):
            k[i] += share * change[i]
        if worst < EXACT or (worst < AS_EXACT_AS_CAN_BE and norm >= before):
            break


def stages(
    x: Vector,
    k: Matrix,
    stage: int,
    hs: float,
    u: Vector,
    c: Vector,
    y: Vector,
    space: Matrix,
    M: Matrix,
    order: Indices,
) -> None:
    """Compute the slope k[stage] and its argument y from the slopes of the previous stages."""
    for i in range(len(x)):
        y[i] = x[i]
        for j in range(stage):
            y[i] += hs * STAGES[stage][j] * k[j, i]
    if stage == 0:
        slope(y, u, c, k[0])
        return
    for i in range(len(x)):
        k[stage, i] = k[stage - 1, i]
    solve_stage(y, k[stage], hs * GAMMA, u, c, space, M, order)
    for i in range(len(x)):
        y[i] += hs * GAMMA * k[stage, i]


def step(x: Vector, V: Vector, u0: Vector, u1: Vector, c: Vector, h: float, substeps: int) -> None:
    """Advance x by one sample of length h, in `substeps` implicit steps."""
    k, u, y = np.zeros((6, NX)), np.empty(NU), np.empty(NX)
    M, space, order = np.empty((NX, NX)), np.empty((4, NX)), np.empty(NX, dtype=np.int64)
    hs = h / substeps
    for s in range(substeps):
        for stage in range(6):
            inputs(u0, u1, (s + NODES[stage]) / substeps, h, u)
            stages(x, k, stage, hs, u, c, y, space, M, order)
        for i in range(NX):
            x[i] = y[i]  # stiffly accurate: the last argument is the result


def step_columns(
    columns: int, x: Vector, V: Vector, u0: Vector, u1: Vector, c: Vector, h: float, substeps: int
) -> None:
    """Advance as `step`, and update the sensitivities in V, whose rows have `columns` numbers."""
    k, u, y, f = np.zeros((6, NX)), np.empty(NU), np.empty(NX), np.empty(NX)
    M, space, order = np.empty((NX, NX)), np.empty((4, NX)), np.empty(NX, dtype=np.int64)
    A, B, G = np.empty((NX, NX)), np.empty((NX, max(NP, 1))), np.empty((NX, NU))
    new = 7 * NX * columns
    hs = h / substeps
    for s in range(substeps):
        for stage in range(6):
            inputs(u0, u1, (s + NODES[stage]) / substeps, h, u)
            stages(x, k, stage, hs, u, c, y, space, M, order)
            hg = hs * GAMMA if stage > 0 else 0.0
            linearise(y, u, c, f, A, B, G)
            matrix(y, hg, u, c, M, order)
            # (1 - hg A) D_stage = A (W + hs sum of earlier D) + B, all columns at once
            for i in range(NX):
                for j in range(columns):
                    V[new + i * columns + j] = V[i * columns + j]
                for m in range(stage):
                    weight = hs * STAGES[stage][m]
                    for j in range(columns):
                        V[new + i * columns + j] += weight * V[((m + 1) * NX + i) * columns + j]
            first = (stage + 1) * NX * columns
            for i in range(NX):
                row = order[i]
                for j in range(columns):
                    V[first + i * columns + j] = 0.0
                for n in range(NX):
                    weight = A[row, n]
                    for j in range(columns):
                        V[first + i * columns + j] += weight * V[new + n * columns + j]
                for n in range(NP):
                    V[first + i * columns + n] += B[row, n]
                if columns >= NP + NX + NU:
                    for n in range(NU):
                        V[first + i * columns + NP + NX + n] += G[row, n]
                for n in range(i):
                    weight = M[i, n]
                    for j in range(columns):
                        V[first + i * columns + j] -= weight * V[first + n * columns + j]
            for i in range(NX - 1, -1, -1):
                for n in range(i + 1, NX):
                    weight = M[i, n]
                    for j in range(columns):
                        V[first + i * columns + j] -= weight * V[first + n * columns + j]
                weight = 1.0 / M[i, i]
                for j in range(columns):
                    V[first + i * columns + j] *= weight
        for i in range(NX):
            x[i] = y[i]
            for m in range(6):
                weight = hs * STAGES[5][m]
                for j in range(columns):
                    V[i * columns + j] += weight * V[((m + 1) * NX + i) * columns + j]
