"""Small symmetric positive definite matrices of information, compiled like `loops.noise`.

In NumPy, an estimate from ten parameters takes some twenty calls of a few microseconds each.
"""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.cell.loops.arrays import Indices, Matrix, Vector

ROUNDED = 1e-14  # smallest pivot of a matrix with a unit diagonal that rounding leaves


def inverse(matrix: Matrix, found: Matrix) -> float:
    """Invert a matrix (k, k) into `found` (k, k); return the smallest pivot (Cholesky, scaled to a unit diagonal).

    Parameters have very different units. A matrix that is singular by rounding gets a pivot of `ROUNDED`.
    """
    k = len(matrix)
    scale, L = np.empty(k), np.zeros((k, k))
    least = 1.0
    for i in range(k):
        scale[i] = 1.0 / math.sqrt(matrix[i, i])
    for j in range(k):
        for i in range(j, k):
            total = matrix[i, j] * scale[i] * scale[j]
            for m in range(j):
                total -= L[i, m] * L[j, m]
            if i == j:
                least = min(least, total)
                L[j, j] = math.sqrt(max(total, ROUNDED))
            else:
                L[i, j] = total / L[j, j]
    for j in range(k):  # the inverse of L, in place
        L[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, k):
            total = 0.0
            for m in range(j, i):
                total -= L[i, m] * L[m, j]
            L[i, j] = total / L[i, i]
    for i in range(k):
        for j in range(i + 1):
            total = 0.0
            for m in range(i, k):
                total += L[m, i] * L[m, j]
            found[i, j] = total * scale[i] * scale[j]
            found[j, i] = found[i, j]
    return least


def solve(matrix: Matrix, inverted: Matrix, right: Vector, found: Vector) -> None:
    """Solve a system (k, k) for `right` (k) with the inverse of its matrix, and one step of iterative refinement."""
    k = len(right)
    left = np.empty(k)
    for i in range(k):
        found[i] = 0.0
        for j in range(k):
            found[i] += inverted[i, j] * right[j]
    for i in range(k):
        left[i] = right[i]
        for j in range(k):
            left[i] -= matrix[i, j] * found[j]
    for i in range(k):
        for j in range(k):
            found[i] += inverted[i, j] * left[j]


def newest(
    matrix: Matrix,
    vector: Vector,
    noise: Matrix,
    more: Matrix,
    more_vector: Vector,
    wider: Vector,
    widened: Matrix,
    bias: Vector,
    doubt: Matrix,
    reference: Vector,
    unit: Vector,
    mean: Vector,
    covariance: Matrix,
) -> float:
    """Estimate from a memory and samples that are not in it yet.

    Return how far the estimate is, at most, from the parameters at which the samples passed the filter: in units of a
    coordinate, of those that are farther away than their standard deviation.

    Inputs:
        matrix (k, k), vector (k), noise (k, k): of the memory: sums of information, of vectors, and the covariance of
            these.
        more (k, k), more_vector (k): information and vector of the further samples.
        wider (k): factors on the standard deviations, as in `Memory.wider`.
        widened (k, k): as from `Levels.wider`.
        bias (k): that is taken off, and counts as uncertain.
        doubt (k, k): what else is added to the covariance.
        reference (k), unit (k): parameters at which the samples passed the filter, and units of the coordinates.

    Outputs:
        mean (k), covariance (k, k).
    """
    k = len(vector)
    A, P, M, N = np.empty((k, k)), np.empty((k, k)), np.empty((k, k)), np.empty((k, k))
    left = np.empty(k)
    for i in range(k):
        for j in range(k):
            A[i, j] = matrix[i, j] + more[i, j]
            N[i, j] = noise[i, j] + more[i, j]
    for i in range(k):
        left[i] = vector[i] + more_vector[i]
    _ = inverse(A, P)
    solve(A, P, left, mean)
    for i in range(k):
        mean[i] -= bias[i]
    product(P, N, M)
    product_transposed(M, P, N)
    for i in range(k):
        for j in range(k):
            N[i, j] *= wider[i] * wider[j]
    product(widened, N, M)
    product_transposed(M, widened, covariance)
    farthest = 0.0
    for i in range(k):
        away = abs(mean[i] + bias[i] - reference[i])
        if away > math.sqrt(covariance[i, i] + doubt[i, i]):
            farthest = max(farthest, away / unit[i])
        for j in range(k):
            covariance[i, j] += bias[i] * bias[j] + doubt[i, j]
    return farthest


def change(
    precision: Matrix,
    weighted: Vector,
    matrix: Matrix,
    vector: Vector,
    score: Vector,
    information: Matrix,
    mean: Vector,
) -> None:
    """Compute score and information of a change between a memory and a stretch after it: see `online.score_test`.

    Inputs:
        precision (k, k), weighted (k): inverse of the covariance of the estimate before, and that times the estimate.
        matrix (k, k), vector (k): what the stretch says.

    Outputs:
        score (k), information (k, k), and the mean (k) of the memory.
    """
    k = len(vector)
    A, P, M, left = np.empty((k, k)), np.empty((k, k)), np.empty((k, k)), np.empty(k)
    _ = inverse(precision, P)
    solve(precision, P, weighted, mean)
    for i in range(k):
        for j in range(k):
            A[i, j] = precision[i, j] + matrix[i, j]
    for i in range(k):
        left[i] = vector[i]
        for j in range(k):
            left[i] -= matrix[i, j] * mean[j]
    _ = inverse(A, P)
    product(precision, P, A)
    product(A, matrix, M)
    for i in range(k):
        score[i] = 0.0
        for j in range(k):
            score[i] += A[i, j] * left[j]
            information[i, j] = 0.5 * (M[i, j] + M[j, i])


def product(A: Matrix, B: Matrix, found: Matrix) -> None:
    """Write A B to `found`, all (k, k)."""
    k = len(A)
    for i in range(k):
        for j in range(k):
            found[i, j] = 0.0
        for m in range(k):
            for j in range(k):
                found[i, j] += A[i, m] * B[m, j]


def product_transposed(A: Matrix, B: Matrix, found: Matrix) -> None:
    """Write A B' to `found`, all (k, k)."""
    k = len(A)
    for i in range(k):
        for j in range(k):
            found[i, j] = 0.0
            for m in range(k):
                found[i, j] += A[i, m] * B[j, m]


def of_free(
    H: Matrix,
    g: Vector,
    columns: Indices,
    slope: Vector,
    z: Vector,
    first: int,
    count: int,
    e: Matrix,
    S: Matrix,
    y: Matrix,
    matrix: Matrix,
    vector: Vector,
    white: Matrix,
) -> float:
    """Add what a stretch says of the free parameters, from what `loops.tracking.track` found.

    Return the largest innovation over its standard deviation.

    Inputs:
        H (NP, NP), g (NP): information and score of the stretch.
        columns (k): places of the free parameters in H and g.
        slope (k), z (k): derivatives of their values by the coordinates, and these.
        first, count: row of the sample before, and number of samples.
        e, S, y (rows, NY): innovations, their variances, and the labels.

    Outputs:
        matrix (k, k), vector (k): the stretch alone says matrix z = vector; added to what is there.
        white (rows, NY): innovations over their standard deviations, NaN where a label is missing.
    """
    k = len(z)
    for i in range(k):
        vector[i] += g[columns[i]] * slope[i]
        for j in range(k):
            more = H[columns[i], columns[j]] * slope[i] * slope[j]
            matrix[i, j] += more
            vector[i] += more * z[j]
    largest = 0.0
    for t in range(first + 1, first + 1 + count):
        for j in range(white.shape[1]):
            if math.isnan(y[t, j]):
                white[t, j] = math.nan
            else:
                white[t, j] = e[t, j] / math.sqrt(S[t, j])
                largest = max(largest, abs(white[t, j]))
    return largest
