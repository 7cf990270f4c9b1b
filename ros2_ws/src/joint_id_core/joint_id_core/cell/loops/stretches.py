"""Scores of a change at the begin of each of the newest stretches of samples, compiled like `loops.information`."""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.cell.loops.arrays import Cube, Indices, Matrix, Vector
from joint_id_core.cell.loops.information import change, inverse

CLEAR = 1e6  # largest trace of the inverse, scaled to a unit diagonal, of an information without doubt of full rank


def scan(
    precision: Cube,
    weighted: Matrix,
    matrices: Cube,
    vectors: Matrix,
    lengths: Indices,
    excess: Vector,
    score: Matrix,
    information: Cube,
    mean: Matrix,
    total: Vector,
    largest: Vector,
) -> None:
    """Compute what `online.score_test` asks of stretches of the newest blocks.

    Inputs:
        precision (n, k, k), weighted (n, k): before each block, the inverse of the covariance of the estimate, and that
            times the estimate.
        matrices (n, k, k), vectors (n, k): what each block says.
        lengths (L): of the stretches, in blocks, rising.
        excess (k): by which the square of each score is divided.

    Outputs:
        score (L, k), information (L, k, k), mean (L, k): as of `information.change`.
        total (L): v' M^-1 v of score v and information M; NaN where M may not have full rank.
        largest (L): squared score of one parameter over its variance and excess.
    """
    n, k, done = len(matrices), len(excess), 0
    matrix, vector, P = np.zeros((k, k)), np.zeros(k), np.empty((k, k))
    for s in range(len(lengths)):
        for b in range(done, lengths[s]):
            for i in range(k):
                vector[i] += vectors[n - 1 - b, i]
                for j in range(k):
                    matrix[i, j] += matrices[n - 1 - b, i, j]
        done = lengths[s]
        first = n - done
        change(precision[first], weighted[first], matrix, vector, score[s], information[s], mean[s])
        largest[s] = 0.0
        for i in range(k):
            square = score[s, i] * score[s, i] / max(information[s, i, i], 1e-300) / excess[i]
            largest[s] = max(largest[s], square)
        _ = inverse(information[s], P)
        trace, total[s] = 0.0, 0.0
        for i in range(k):
            trace += P[i, i] * information[s, i, i]
            for j in range(k):
                total[s] += score[s, i] * P[i, j] * score[s, j]
        if not trace < CLEAR:
            total[s] = math.nan
