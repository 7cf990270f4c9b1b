"""Compiled functions of a hop, against plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.models import build
from joint_id_core.online.newest_innovations import ENOUGH, NewestInnovations

PERIOD = 0.002


def led(signals, times=None, checked=0.0, first=0, inputs=2, rows=8):
    """The longest step, and what `lead` writes, which begins at 1 s."""
    labels, count = len(signals) - inputs, signals.shape[1]
    times = 1.0 + PERIOD * np.arange(1.0, count + 1.0) if times is None else times
    shapes = ((rows,), (rows, inputs), (rows, labels), (rows,))
    found = [np.full(shape, 7.0) for shape in shapes]
    found[0][first] = 1.0
    return compile_shared().lead(signals, times, PERIOD, checked, first, *found), found


@given(missing=st.lists(st.integers(0, 3), max_size=12), seed=st.integers(0, 1000), first=st.integers(0, 3))
def test_samples_are_written_behind_those_that_are_there(missing, seed, first):
    rng, count = np.random.default_rng(seed), len(missing)
    steps = (np.array(missing) + 1.0 + rng.uniform(-0.2, 0.2, count)) * PERIOD
    times, signals = 1.0 + np.cumsum(steps), rng.standard_normal((5, count))
    signals[2:][rng.random((3, count)) < 0.1] = np.nan  # a label that is missing does no harm
    longest, (time, u, y, gap) = led(signals, times, first=first, rows=20)
    new = slice(first + 1, first + 1 + count)
    np.testing.assert_array_equal(time[new], times)
    np.testing.assert_array_equal(u[new], signals[:2].T)
    np.testing.assert_array_equal(y[new], signals[2:].T)
    if count:
        np.testing.assert_array_equal(gap[first : first + 1 + count], [*missing, 0])
    assert longest == pytest.approx(steps.max(initial=0.0))
    assert (u[: first + 1] == 7.0).all() and (y[first + 1 + count :] == 7.0).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_input_that_is_not_finite_is_noticed(bad):
    signals = np.ones((3, 5))
    signals[1, 3] = bad
    assert np.isnan(led(signals)[0])
    assert led(signals, checked=1.0)[0] == pytest.approx(PERIOD)


def test_a_label_that_repeats_a_zero_is_noticed():
    signals = np.ones((3, 5))
    signals[2] = [1.0, 1.0, 0.0, 2.0, 0.0]
    assert led(signals)[0] == pytest.approx(PERIOD)
    signals[2, 3] = 0.0
    assert np.isnan(led(signals)[0])


@given(seed=st.integers(0, 10**6))
def test_physical_values_are_those_of_the_coordinates(seed):
    model, rng = build("rigid_joint"), np.random.default_rng(seed)
    free = ("J", "c", "tau_f", "tau_0")  # of which the last may be negative
    coordinates = Coordinates(model, free)
    z, root = rng.standard_normal(4) * [3.0, 3.0, 3.0, 50.0], rng.standard_normal((4, 4))
    values, sigma, found = np.empty(4), np.empty(4), np.empty((4, 4))
    compile_shared().physical(
        z, root @ root.T, coordinates.lower, coordinates.upper, coordinates.logarithm, values, sigma, found
    )
    clipped = coordinates.clip(z)
    slope = coordinates.slope(clipped)
    np.testing.assert_allclose(values, coordinates.values(clipped))
    np.testing.assert_allclose(found, root @ root.T * np.outer(slope, slope))
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(found)))


@given(seed=st.integers(0, 10**6), count=st.integers(0, 4))
def test_values_that_are_apart_are_found(seed, count):
    rng, far, least = np.random.default_rng(seed), 2.0, 0.1
    positive = np.array([1.0, 0.0, 1.0])
    values, sigma = rng.uniform(0.5, 2.0, 3), rng.uniform(0.01, 1.0, 3)
    sigma[rng.integers(3)] = np.nan
    told, told_sigma = np.log(rng.uniform(0.5, 2.0, (count, 3))), rng.uniform(0.01, 1.0, (count, 3))
    z = np.where((positive > 0.0) & np.isfinite(sigma), np.log(values), values)
    s = np.where(positive > 0.0, sigma / values, sigma)
    away = np.abs(z - told)
    expected = ((away > far * np.hypot(s, told_sigma)) & ((positive == 0.0) | (away >= least))).any()
    assert compile_shared().apart(values, sigma, positive, told, told_sigma, far, least) == expected
    np.testing.assert_allclose(values, z)
    np.testing.assert_allclose(sigma, s)


def test_innovations_of_the_last_window():
    rng, found = np.random.default_rng(0), NewestInnovations(1.0)
    assert found.chi2 is None
    blocks = [rng.standard_normal((250, 2)) * [1.0, sigma] for sigma in (9.0, 1.0, 1.0)]
    blocks[1][::3, 0] = np.nan
    for white in blocks:
        found.add(white)
    newest = np.concatenate(blocks[1:])  # of 1 s
    assert found.chi2 == pytest.approx(np.nanmean(newest**2))
    assert not found.noise_changed
    found.add(rng.standard_normal((250, 2)) * [1.0, 2.0])
    assert found.noise_changed
    found.clear()
    few = np.full((250, 2), np.nan)
    few[:ENOUGH, 0] = 9.0
    found.add(few)
    assert not found.noise_changed
    found.clear()
    found.add(np.full((250, 2), np.nan))
    assert np.isnan(found.chi2)
