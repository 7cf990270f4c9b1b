"""Friction with a memory after reversals: what it does to inertia and friction of a regression."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Regression, fit
from joint_id_core.estimators.shared.hysteresis import hysteresis
from joint_id_core.models import build
from joint_id_core.simulation.excitation import build_multisine, harmonics

from .quick import first_quick

MODEL = build("rigid_joint")
TRUTH = {"J": 2.0, "c": 10.0, "tau_f": 8.0}
RATE, FINE = 100, 20  # samples/s, and steps between two samples


def dahl(position: np.ndarray, reach: float) -> np.ndarray:
    """Dahl's model d(z)/d(x) = (1 - z sign(dx)) / reach in small steps, from zero."""
    z = np.zeros(len(position))
    for k in range(1, len(z)):
        step = position[k] - position[k - 1]
        z[k] = z[k - 1] + (step - abs(step) * z[k - 1]) / reach
    return z


@functools.cache
def recorded(seed: int, reach: float) -> tuple[Recording, np.ndarray]:
    """A joint along a slow path, and plain least squares of its exact torque: J, c, tau_f, offset."""
    t = np.arange(30 * RATE * FINE) / (RATE * FINE)
    path = build_multisine(0.8, harmonics(0.1, 0.6, 10.0), seed, roll_off=1.0)
    q, w = path.value(t), path.rate(t)
    a = np.gradient(w, t)
    z = dahl(q, reach) if reach else np.sign(w)
    torque = TRUTH["J"] * a + TRUTH["c"] * w + TRUTH["tau_f"] * z
    plain = np.linalg.lstsq(np.column_stack([a, w, np.sign(w), np.ones_like(w)]), torque, rcond=None)[0]
    rng, count = np.random.default_rng(seed), len(t) // FINE
    channels = {
        "link_position": q[::FINE] + 1e-5 * rng.standard_normal(count),
        "torque": torque.reshape(count, FINE).mean(axis=1) + 0.1 * rng.standard_normal(count),  # held between samples
    }
    return Recording(t[::FINE], channels, source="presliding"), plain


def test_hysteresis_is_that_of_dahl():
    fine = np.sin(np.linspace(0.0, 12.0, 200001)) + 0.3 * np.sin(np.linspace(0.0, 40.0, 200001))
    path = fine[::10]
    assert np.allclose(hysteresis(path, 0.05), dahl(fine, 0.05)[::10], atol=2e-3)
    still = np.concatenate([path[:9000], np.full(500, path[8999]), path[9000:]])
    found = hysteresis(still, 0.05)
    assert np.allclose(found[8999:9500], found[8999]) and np.allclose(found[-1], hysteresis(path, 0.05)[-1])


@pytest.mark.parametrize("reach", [0.01, 0.03])
@pytest.mark.parametrize("seed", first_quick(range(3)))
def test_inertia_is_right_where_plain_least_squares_makes_it_half(seed, reach):
    recording, plain = recorded(seed, reach)
    found = fit(MODEL, recording, None, Regression())
    assert found.converged and plain[0] < 0.65 * TRUTH["J"]
    assert found["J"].value == pytest.approx(TRUTH["J"], rel=0.15)
    for name, truth in TRUTH.items():
        assert abs(found[name].value - truth) < 1.96 * found[name].std_dev
    assert any("turns over some distance" in note for note in found.notes)
    assert found["J"].std_dev < 0.6 * TRUTH["J"], "a late drive, which it looks like without the memory, is not in it"
    assert not any("late" in note or "between two samples" in note for note in found.notes)


@pytest.mark.parametrize("seed", first_quick(range(3)))
def test_friction_without_a_memory_is_as_before(seed):
    recording, _ = recorded(seed, 0.0)
    found = fit(MODEL, recording, None, Regression())
    assert not any("turns over" in note for note in found.notes)
    for name, truth in TRUTH.items():
        assert abs(found[name].value - truth) < 4.0 * found[name].std_dev < 0.04 * truth
