"""Symmetric positive definite systems of parameters with very different units."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array


def solve(matrix: Array, right: Array) -> Array:
    """Solve a symmetric positive definite system (n, n), scaled to a unit diagonal, for `right`, (n,) or (n, m)."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    solved = np.linalg.solve(matrix * scale[:, None] * scale, (right.T * scale).T)
    return np.asarray((solved.T * scale).T)


def inverse_of(matrix: Array) -> Array:
    """Invert one in the same way."""
    scale = 1.0 / np.sqrt(matrix.diagonal())
    return np.asarray(np.linalg.inv(matrix * scale[:, None] * scale) * scale[:, None] * scale)
