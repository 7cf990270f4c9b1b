"""Compiled algebra of information matrices, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.online.symmetric import inverse_of, solve


def information(rng, k, samples=40, decades=6.0):
    """An information matrix of k parameters with units that differ by up to twice as many decades."""
    units = 10.0 ** rng.uniform(-decades, decades, k)
    rows = rng.standard_normal((samples, k)) * units
    return rows.T @ rows


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), k=st.integers(1, 14))
def test_inverse_and_solution_are_those_of_numpy_whatever_the_units(seed, k):
    rng = np.random.default_rng(seed)
    matrix = information(rng, k)
    scale = 1.0 / np.sqrt(np.diag(matrix))
    expected = np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
    found = inverse_of(matrix)
    np.testing.assert_array_equal(found, found.T)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-8)
    truth = rng.standard_normal((k, 3)) * scale[:, None]
    np.testing.assert_allclose(solve(matrix, matrix @ truth) / sigma[:, None], truth / sigma[:, None], atol=1e-6)
    np.testing.assert_allclose(solve(matrix, matrix @ truth[:, 0]) / sigma, truth[:, 0] / sigma, atol=1e-6)


def test_a_matrix_that_is_singular_by_rounding_gives_finite_values():
    """Two parameters that samples show only together, beside a weak prior."""
    row = np.array([1.0, 1.0, 0.5])
    matrix = 1e16 * np.outer(row, row) + np.diag([1e-3, 1e-3, 1.0])
    found = inverse_of(matrix)
    assert np.isfinite(found).all()
    assert (np.diag(found) > 0.0).all()


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), k=st.integers(1, 12))
def test_the_newest_estimate_is_that_of_the_formula(seed, k):
    rng = np.random.default_rng(seed)
    matrix, more, noise = (information(rng, k, decades=2.0) for _ in range(3))
    units = 1.0 / np.sqrt(np.diag(matrix + more))
    vector, more_vector = matrix @ (units * rng.standard_normal(k)), more @ (units * rng.standard_normal(k))
    wider, widened = rng.uniform(1.0, 3.0, k), np.eye(k) + 0.1 * units[:, None] * rng.standard_normal((k, k)) / units
    bias = units * rng.standard_normal(k)
    mean, covariance = np.empty(k), np.empty((k, k))
    compile_shared().newest(matrix, vector, noise, more, more_vector, wider, widened, bias, mean, covariance)
    inverse = units[:, None] * np.linalg.inv((matrix + more) * np.outer(units, units)) * units
    spread = inverse @ (noise + more) @ inverse * np.outer(wider, wider)
    expected = widened @ spread @ widened.T + np.outer(bias, bias)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-8)
    np.testing.assert_allclose(mean / sigma, (inverse @ (vector + more_vector) - bias) / sigma, atol=1e-6)


def test_information_is_not_changed_by_an_estimate():
    matrix = information(np.random.default_rng(3), 5)
    before = matrix.copy()
    inverse_of(matrix)
    np.testing.assert_array_equal(matrix, before)
    assert inverse_of(np.array([[4.0]])) == pytest.approx(0.25)
