"""Small linear algebra of one Gauss-Newton iteration, compiled like `loops.noise`.

In NumPy these few operations on matrices of ten rows took a third of the time of a fit.
"""

from __future__ import annotations

import numpy as np

from joint_id_core.cell.loops.arrays import Matrix, Vector


def with_prior(
    H: Matrix,
    g: Vector,
    slope: Vector,
    z: Vector,
    mean: Vector,
    precision: Matrix,
    hessian: Matrix,
    gradient: Vector,
) -> float:
    """Add a Gaussian prior to the Gauss-Newton matrix and gradient; return its part of the cost.

    H (k, k) and g (k) refer to physical values; slope (k) is the derivative of these by the coordinates z (k).
    hessian (k, k) and gradient (k) receive the sums, by coordinates.
    """
    cost = 0.0
    for i in range(len(z)):
        pull = 0.0
        for j in range(len(z)):
            pull += precision[i, j] * (z[j] - mean[j])
            hessian[i, j] = H[i, j] * slope[i] * slope[j] + precision[i, j]
        gradient[i] = g[i] * slope[i] - pull
        cost += (z[i] - mean[i]) * pull
    return cost


def damped_step(
    hessian: Matrix,
    gradient: Vector,
    z: Vector,
    lower: Vector,
    upper: Vector,
    unit: Vector,
    damping: float,
    longest: float,
    step: Vector,
    there: Vector,
) -> float:
    """Compute one step of Levenberg's method; return its squared length step' H step, in standard deviations.

    A coordinate on a bound (`lower`, `upper`) that the gradient would push across it is held. there (k): z plus the
    step, which is shortened so that no coordinate moves by more than `longest` times its `unit`, within the bounds.
    The matrix is positive definite, so that the elimination needs no pivots.
    """
    k = len(z)
    A, held = np.empty((k, k)), np.zeros(k)
    for i in range(k):
        if (z[i] <= lower[i] and gradient[i] < 0.0) or (z[i] >= upper[i] and gradient[i] > 0.0):
            held[i] = 1.0
    for i in range(k):
        step[i] = 0.0 if held[i] > 0.0 else gradient[i]
        for j in range(k):
            A[i, j] = 0.0 if held[i] + held[j] > 0.0 else hessian[i, j]
        A[i, i] = 1.0 if held[i] > 0.0 else A[i, i] * (1.0 + damping)
    for i in range(k):
        for m in range(i + 1, k):
            factor = A[m, i] / A[i, i]
            for j in range(i, k):
                A[m, j] -= factor * A[i, j]
            step[m] -= factor * step[i]
    square, share = 0.0, 0.0
    for i in range(k - 1, -1, -1):
        for j in range(i + 1, k):
            step[i] -= A[i, j] * step[j]
        step[i] /= A[i, i]
        share = max(share, abs(step[i]) / unit[i])
    share = longest / share if share > longest else 1.0
    for i in range(k):
        for j in range(k):
            square += step[i] * hessian[i, j] * step[j]
        there[i] = min(max(z[i] + share * step[i], lower[i]), upper[i])
    return square
