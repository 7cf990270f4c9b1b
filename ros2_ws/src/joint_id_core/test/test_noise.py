"""Steps of the noise levels, and the part of a record that a fit begins on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Recording
from joint_id_core.estimators.innovations.noise import LARGEST_CHANGE, RIDGE, UNKNOWN, bounded_step, unknown_levels
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.initial_state import busiest
from joint_id_core.models import build

MODEL = build("rigid_joint")


@pytest.fixture(scope="module")
def kernel():
    return compile_model(MODEL)


@given(seed=st.integers(0, 10_000), size=st.floats(0.1, 100.0), room=st.floats(1.1, 1e4))
def test_a_step_of_the_levels_is_the_best_within_its_bounds(kernel, seed, size, room):
    """Free levels solve their own equations beside what the held ones do; held ones sit on a bound."""
    rng = np.random.default_rng(seed)
    count = 5
    levels = 10.0 ** rng.uniform(-8.0, 2.0, count)
    root = rng.standard_normal((count, count))
    relative = root @ root.T + np.eye(count)
    score = size * rng.standard_normal(count)
    step, decrement = bounded_step(kernel, levels, levels / room, levels * room, score, relative)
    change, limit = np.expm1(step), min(LARGEST_CHANGE, room)
    held = np.isclose(change, limit - 1.0) | np.isclose(change, 1.0 / limit - 1.0)
    assert np.all(change <= limit - 1.0 + 1e-9) and np.all(change >= 1.0 / limit - 1.0 - 1e-9)
    left = score - (relative + RIDGE * np.eye(count)) @ change
    assert np.all(np.abs(left[~held]) < 1e-6 * (1.0 + np.abs(score).max()))
    assert decrement == pytest.approx(step @ relative @ step)


@given(begin=st.integers(0, 3000), length=st.integers(250, 1000))
@example(begin=2993, length=801)  # at the end of the record
def test_the_busiest_part_holds_the_motion(begin, length):
    """A joint that rests but for one swing, some labels missing: the part found overlaps it by more than half."""
    samples, swing = 4000, length
    begin = min(begin, samples - swing)
    rng = np.random.default_rng(begin)
    wave = np.zeros(samples)
    wave[begin : begin + swing] = np.sin(np.linspace(0.0, 12.0, swing))
    noise = 1e-3 * rng.standard_normal((3, samples))
    noise[0, rng.random(samples) < 0.2] = np.nan
    names = ("link_position", "link_velocity", "torque")
    record = Recording(np.arange(samples) * 2e-3, {n: wave + e for n, e in zip(names, noise, strict=True)})
    data = prepare(MODEL, record)
    first = busiest(data, length)
    assert 0 <= first <= samples - length
    assert min(first + length, begin + swing) - max(first, begin) > length // 2
    part = data.part(first, first + length)
    np.testing.assert_array_equal(part.time, data.time[first : first + length])
    assert part.y.flags.c_contiguous and len(part.u) == len(part.gap) == length


@given(seed=st.integers(0, 1000), parameters=st.integers(1, 9), levels=st.integers(1, 4))
def test_unknown_levels_widen_like_unknown_parameters(seed, parameters, levels):
    """With what is added, the covariance is the block of the inverse of the whole information matrix."""
    k = parameters
    root = np.random.default_rng(seed).standard_normal((k + levels, 2 * (k + levels)))
    whole = root @ root.T
    inverse = np.linalg.inv(whole[:k, :k])
    added = unknown_levels(inverse, whole[k:, k:] - UNKNOWN**-2 * np.eye(levels), whole[:k, k:])
    np.testing.assert_allclose(inverse + added, np.linalg.inv(whole)[:k, :k], rtol=1e-6, atol=1e-9)
