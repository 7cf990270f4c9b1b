"""Compiled algebra of information matrices, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.online.score_test import score_of
from joint_id_core.online.symmetric import inverse_of, solve


def information(rng, k, samples=40, decades=6.0):
    """An information matrix of k parameters with units that differ by up to twice as many decades."""
    units = 10.0 ** rng.uniform(-decades, decades, k)
    rows = rng.standard_normal((samples, k)) * units
    return rows.T @ rows


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


@given(seed=st.integers(0, 10**6), k=st.integers(1, 12))
def test_the_score_of_a_change_is_that_of_the_formula(seed, k):
    """Score P^-1 (P^-1 + H)^-1 (h - H z) and information P^-1 (P^-1 + H)^-1 H, in units of the parameters."""
    rng = np.random.default_rng(seed)
    precision, matrix = information(rng, k, decades=2.0), information(rng, k, decades=2.0)
    units = 1.0 / np.sqrt(np.diag(precision + matrix))
    z = units * rng.standard_normal(k)
    vector = matrix @ (units * rng.standard_normal(k))
    score, found, mean = score_of(precision, precision @ z, matrix, vector)
    both = np.outer(units, units)
    inverse = np.linalg.inv((precision + matrix) * both)
    weight = precision * both @ inverse
    np.testing.assert_allclose(mean / units, z / units, atol=1e-6 * np.linalg.cond(precision * both))
    np.testing.assert_allclose(score * units, weight @ ((vector - matrix @ z) * units), atol=1e-6)
    np.testing.assert_allclose(found * both, weight @ (matrix * both), atol=1e-6)
    np.testing.assert_array_equal(found, found.T)


def test_what_a_stretch_says_of_the_free_parameters():
    rng = np.random.default_rng(0)
    H, g, columns = information(rng, 6), rng.standard_normal(6), np.array([4, 0, 3])
    slope, z = rng.uniform(0.5, 2.0, 3), rng.standard_normal(3)
    e, S, y = rng.standard_normal((8, 2)), rng.uniform(1.0, 4.0, (8, 2)), rng.standard_normal((8, 2))
    y[3, 1] = np.nan
    matrix, vector, white = np.empty((3, 3)), np.empty(3), np.empty((7, 2))
    compile_shared().of_free(H, g, columns, slope, z, e, S, y, matrix, vector, white)
    expected = H[np.ix_(columns, columns)] * np.outer(slope, slope)
    np.testing.assert_allclose(matrix, expected)
    np.testing.assert_allclose(vector, g[columns] * slope + expected @ z)
    np.testing.assert_allclose(white, np.where(np.isnan(y[1:]), np.nan, (e / np.sqrt(S))[1:]))


def test_information_is_not_changed_by_an_estimate():
    matrix = information(np.random.default_rng(3), 5)
    before = matrix.copy()
    inverse_of(matrix)
    np.testing.assert_array_equal(matrix, before)
    assert inverse_of(np.array([[4.0]])) == pytest.approx(0.25)
