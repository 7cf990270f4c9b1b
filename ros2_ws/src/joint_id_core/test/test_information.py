"""Compiled algebra of information matrices, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.online.score_test import changed_parameters, chi2, score_of, stretches
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
    bias, unit, z = units * rng.standard_normal(k), rng.uniform(0.5, 2.0, k), units * rng.standard_normal(k)
    doubt = np.diag(0.1 * units**2)
    mean, covariance = np.empty(k), np.empty((k, k))
    away = compile_shared().newest(
        matrix, vector, noise, more, more_vector, wider, widened, bias, doubt, z, unit, mean, covariance
    )
    inverse = units[:, None] * np.linalg.inv((matrix + more) * np.outer(units, units)) * units
    spread = inverse @ (noise + more) @ inverse * np.outer(wider, wider)
    alone = widened @ spread @ widened.T + doubt
    expected = alone + np.outer(bias, bias)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-8)
    np.testing.assert_allclose(mean / sigma, (inverse @ (vector + more_vector) - bias) / sigma, atol=1e-6)
    distance = np.abs(mean + bias - z)
    assert away == pytest.approx(np.max((distance / unit)[distance > np.sqrt(np.diag(alone))], initial=0.0))


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


@given(seed=st.integers(0, 10**6), k=st.integers(1, 9), n=st.integers(1, 12))
def test_stretches_of_blocks_have_the_scores_of_their_sums(seed, k, n):
    rng = np.random.default_rng(seed)
    precision, matrices = ([information(rng, k, decades=1.0) for _ in range(n)] for _ in range(2))
    weighted, vectors = ([a @ rng.standard_normal(k) for a in some] for some in (precision, matrices))
    lengths, excess = sorted(set(rng.integers(1, n + 1, 3).tolist())), rng.uniform(1.0, 2.0, k + 1)
    found = stretches(precision, weighted, matrices, vectors, lengths, excess)
    assert [stretch.count for stretch in found] == lengths
    for stretch in found:
        first = n - stretch.count
        sums = np.sum(matrices[first:], axis=0), np.sum(vectors[first:], axis=0)
        score, M, mean = score_of(precision[first], weighted[first], *sums)
        sigma = np.sqrt(np.diag(M))
        np.testing.assert_allclose(stretch.score / sigma, score / sigma, atol=1e-6)
        np.testing.assert_allclose(stretch.information / np.outer(sigma, sigma), M / np.outer(sigma, sigma), atol=1e-9)
        np.testing.assert_allclose(stretch.mean * sigma, mean * sigma, atol=1e-6)
        assert stretch.largest == pytest.approx(np.max((score / sigma) ** 2 / excess[:-1]), rel=1e-6)
        total, rank = chi2(score, M)
        assert rank == k
        np.testing.assert_allclose(stretch.chi2, (total, rank), rtol=1e-6)
        for rare in (1e-7, 0.5):
            whole = changed_parameters(score, M, excess, rare)
            assert (whole is None) or not stretch.surely_none(excess, rare)
            assert (whole is None) == (changed_parameters(score, M, excess, rare, stretch.total) is None)


def test_a_stretch_that_does_not_tell_parameters_apart_has_no_full_rank():
    row = np.array([1.0, 1.0])
    (found,) = stretches([np.eye(2)], [np.zeros(2)], [1e3 * np.outer(row, row)], [1e3 * row], [1], np.ones(3))
    assert np.isnan(found.total)
    assert not found.surely_none(np.ones(3), 1e-7)
    assert found.chi2[1] == 1


def test_what_a_stretch_says_of_the_free_parameters():
    rng = np.random.default_rng(0)
    H, g, columns = information(rng, 6), rng.standard_normal(6), np.array([4, 0, 3])
    slope, z = rng.uniform(0.5, 2.0, 3), rng.standard_normal(3)
    e, S, y = rng.standard_normal((8, 2)), rng.uniform(1.0, 4.0, (8, 2)), rng.standard_normal((8, 2))
    y[3, 1] = np.nan
    matrix, vector, white = np.ones((3, 3)), np.full(3, 2.0), np.zeros((8, 2))
    largest = compile_shared().of_free(H, g, columns, slope, z, 1, 5, e, S, y, matrix, vector, white)
    expected = H[np.ix_(columns, columns)] * np.outer(slope, slope)
    np.testing.assert_allclose(matrix, 1.0 + expected)
    np.testing.assert_allclose(vector, 2.0 + g[columns] * slope + expected @ z)
    np.testing.assert_allclose(white[2:7], np.where(np.isnan(y), np.nan, e / np.sqrt(S))[2:7])
    assert not white[:2].any() and not white[7].any()
    assert largest == pytest.approx(np.nanmax(np.abs(white)))


def test_information_is_not_changed_by_an_estimate():
    matrix = information(np.random.default_rng(3), 5)
    before = matrix.copy()
    inverse_of(matrix)
    np.testing.assert_array_equal(matrix, before)
    assert inverse_of(np.array([[4.0]])) == pytest.approx(0.25)


@given(seed=st.integers(0, 10**6), k=st.integers(1, 6), size=st.floats(-200.0, 200.0), hole=st.booleans())
def test_what_a_path_that_nearly_diverges_leaves_ends_no_test(seed, k, size, hole):
    """It raised LinAlgError: a matrix with elements of 1e43 was scaled by a diagonal that was negative."""
    rng = np.random.default_rng(seed)
    half = 10.0**size * rng.standard_normal((k, k)) * 10.0 ** rng.uniform(-5.0, 5.0, (k, k))
    matrix, score = half + half.T, 10.0**size * rng.standard_normal(k)
    if hole:
        matrix[0, -1] = matrix[-1, 0] = np.nan
    with np.errstate(all="ignore"):
        total, rank = chi2(score, matrix)
        found = changed_parameters(score, matrix, np.ones(k + 1), 1e-6)
    assert total >= 0.0 and 0 <= rank <= k
    assert found is None or set(found[0]) <= set(range(k))
    assert found is not None or np.isfinite(total)
