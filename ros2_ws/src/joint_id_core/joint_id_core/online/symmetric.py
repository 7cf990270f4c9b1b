"""Symmetric positive definite systems of parameters with very different units."""

from __future__ import annotations

import numpy as np

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array


def solve(matrix: Array, right: Array) -> Array:
    """Solve a symmetric positive definite system (n, n) for `right`, (n,) or (n, m)."""
    inverse = inverse_of(matrix)
    found = inverse @ right
    return np.asarray(found + inverse @ (right - matrix @ found))  # a step of iterative refinement


def inverse_of(matrix: Array) -> Array:
    """Invert a symmetric positive definite matrix (n, n), scaled to a unit diagonal."""
    found = np.empty_like(matrix)
    compile_shared().inverse(matrix, found)
    return found
