"""Exact response of linear systems to inputs that vary between their samples, for tests."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm


def exact_linear(A, B, x0, time, u, first, rates):
    """x' = A x + B u by the matrix exponential.

    Inputs in `first` run straight, the others are held. Those with a rate (index of another input) have the curvature
    that its change asks for, so that they are parabolas through both samples.
    """
    n, m = B.shape
    big = np.zeros((n + 3 * m, n + 3 * m))
    big[:n, :n], big[:n, n : n + m] = A, B
    big[n : n + 2 * m, n + m :] = np.eye(2 * m)
    X = [x0]
    for k, dt in enumerate(np.diff(time)):
        change = (u[k + 1] - u[k]) / dt
        curvature = np.array([0.0 if rate is None else change[rate] for rate in rates])
        slope = np.where(first, change - 0.5 * dt * curvature, 0.0)
        X.append((expm(big * dt) @ np.concatenate([X[-1], u[k], slope, curvature]))[:n])
    return np.array(X)
