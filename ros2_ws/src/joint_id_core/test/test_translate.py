"""Compiled functions do what the same functions do in Python."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from joint_id_core.cell.loops import esdirk, noise
from joint_id_core.cell.translate import translated

WEIGHTS = ((0.5, 0.25), (2.0, -1.0))


def ordinary(x: np.ndarray, k: np.ndarray, out: np.ndarray) -> float:
    """Something of all that a compiled function may use."""
    total, size = 0.0, len(x)
    for i in range(size - 1, -1, -1):
        if x[i] < 0.0 and i != 1:
            continue
        if not (x[i] < 50.0 or math.isnan(x[i])):
            break
        total += SCALE * x[k[i]] if k[i] > 0 and x[k[i]] > 1.0 else -1.0 / (2 + i)
        total -= (k[i] // 2) % 2 + x[i] ** 2 - abs(x[0]) ** 0.5 + (0.1 * x[i]) ** 7 - x[i] ** -3
    rows = np.zeros((2, 2))
    for i in range(2):
        row = rows[i]
        for j in range(2):
            row[j] += WEIGHTS[i][j] * 1.0 * (x[j] > 0.0)
    rows[0, 0], rows[1, 1] = rows[1, 1], rows[0, 0]
    counts = np.empty(2, dtype=np.int64)
    counts[0], counts[1] = size, 1
    counts[1] = max(counts[1], int(min(2.7, abs(x[0]))) - 1)
    for i in range(counts[1], counts[0], 2):
        out[i] = max(total, x[i], -3) + min(math.tanh(x[i]), rows[i % 2, 0])
    spread(rows[0], out)
    if ROUNDED:
        undefined_here(x)  # noqa: F821
    return total if total > -1e3 else math.nan


def spread(row: np.ndarray, out: np.ndarray) -> None:
    """Called with a part of an array; changes its own variable and the array."""
    value = row[0]
    for _ in range(2):
        value += row[1]
        if value > 100.0:
            return
    out[0] = value


SCALE, ROUNDED = 3, False


def as_machine_code(function, names=None):
    """The compiled function, with what it calls."""
    call = translated(function, names or {})

    @njit
    def run(*arguments):
        return call(*arguments)

    return run


@pytest.mark.parametrize(
    "x",
    [
        [1.5, 2.0, -0.5, 3.0],
        [-1.0, -2.0, 4.0, 0.3],
        [1.0, 2.0, 60.0, 5.0],
        [2.0, math.nan, 1.0, 7.0],
        [1e3, 1.0, 2.0, 3.0],
    ],
    ids=["all", "continue", "break", "nan", "far"],
)
def test_the_language(x):
    arguments, k = np.array(x), np.array([3, 0, 1, 2])
    expected, found = np.zeros(4), np.zeros(4)
    result = as_machine_code(ordinary)(arguments, k, found)
    assert result == pytest.approx(ordinary(arguments, k, expected), rel=1e-15, nan_ok=True)
    np.testing.assert_allclose(found, expected, rtol=1e-15)


def unsupported(x: np.ndarray) -> None:
    """Uses what compiled functions cannot."""
    x[0] = 1.0
    while x[0] > 0.0:
        x[0] -= 1.0


def nameless(x: np.ndarray) -> None:
    """Uses a name that nobody gives."""
    x[0] = 1.0 + never_given  # noqa: F821


def two_types(x: np.ndarray) -> None:
    """A variable that counts and then measures."""
    value = 0
    for i in range(len(x)):
        value += x[i]
    x[0] = value


@pytest.mark.parametrize(
    ("function", "what"),
    [(unsupported, "while x"), (nameless, "never_given is not known"), (two_types, "double is used as i64")],
)
def test_what_cannot_be_compiled_is_named(function, what):
    with pytest.raises(Exception, match=rf"{function.__name__}, line \d+: .*{what}"):  # numba may wrap it in its own
        as_machine_code(function)(np.ones(3))


def test_noise_statistics_in_python_and_compiled(monkeypatch):
    """The loops are ordinary Python functions: with sizes put in they run as they are."""
    sizes = {"NX": 2, "NU": 1, "CL": 8, "CD": noise.DISTURBANCES, "DELAYED": True}
    for name, size in sizes.items():
        monkeypatch.setattr(noise, name, size, raising=False)
    rng = np.random.default_rng(3)
    T, m, n, p = 6, 2, 2, 3
    y, e, S = rng.normal(size=(T, m)), rng.normal(size=(T, m)), rng.uniform(1.0, 2.0, (T, m))
    y[2, 1] = np.nan
    K, F, C, J = (rng.normal(size=(T, *shape)) for shape in ((m, n), (n, n + 1), (m, n), (m, p)))
    label, begin = np.array([1, 0]), np.array([0, -1, -1, 1, -1, -1])
    columns = noise.DISTURBANCES
    channel, courses = np.zeros(columns, dtype=np.int64), rng.normal(size=(T, columns))
    both = []
    for run in (lambda f: f, as_machine_code):
        score, info, shared = np.empty(3), np.empty((3, 3)), np.empty((p, 3))
        run(noise.noise_information)(y, label, begin, e, S, K, F, C, J, score, info, shared)
        step, level = np.empty(3), np.ones(3)
        length = run(noise.bounded_step)(score, info, level, 0.9 * level, 1.5 * level, 20.0, 1e-3, step)
        cross, total, moved = np.empty((p, columns)), np.empty((columns, columns)), np.empty(columns)
        run(noise.disturbances)(y, label, begin, e, S, K, F, C, J, channel, courses, cross, total, moved)
        both.append((score, info, shared, step, length, cross, total, moved))
    for python, machine in zip(*both, strict=True):
        np.testing.assert_allclose(machine, python, rtol=1e-12, atol=1e-13)


def test_linear_equations_in_python_and_compiled():
    """`esdirk.factor` and `solve`, with pivoting."""
    A, r = np.array([[0.0, 2.0, 1.0], [4.0, 1.0, -1.0], [1.0, 1.0, 3.0]]), np.array([1.0, 2.0, 3.0])
    for run in (lambda f: f, as_machine_code):
        M, order, x = A.copy(), np.zeros(3, dtype=np.int64), np.zeros(3)
        run(esdirk.factor)(M, order)
        run(esdirk.solve)(M, order, r, x)
        np.testing.assert_allclose(x, np.linalg.solve(A, r), rtol=1e-14)
