"""Online intervals contain what is left of the bias of smoothed friction."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.friction_bias import FrictionBias
from joint_id_core.online.summed_effect import SummedEffect
from joint_id_core.simulation import simulate_motion

MODEL = build("rigid_joint")
TRUTH = MODEL.values()
RATE, SECONDS = 125.0, 40.0
NOISE = {"link_position": 2e-5, "torque": 1e-3}  # rad and Nm, little: the bias shows soon


def farthest() -> float:
    """Largest error over its standard deviation, of J after 10 s of a joint that sticks, while it is converged."""
    motion = simulate_motion(MODEL, SECONDS, RATE, noise=False)
    white = np.random.default_rng(1).standard_normal((2, len(motion.time)))
    channels = {name: motion[name] + std * row for (name, std), row in zip(NOISE.items(), white, strict=True)}
    identifier, found = OnlineIdentifier(MODEL, None, OnlineOptions(window_s=2.0)), [0.0]
    for k in range(0, len(motion.time), 10):
        rows = slice(k, k + 10)
        samples = Recording(motion.time[rows], {name: values[rows] for name, values in channels.items()})
        estimate = identifier.update(samples)
        if estimate is not None and estimate.converged and samples.time[-1] > 10.0:
            found.append(abs(estimate["J"].value - TRUTH["J"]) / estimate["J"].std_dev)
    return max(found)


@pytest.mark.long
def test_minutes_of_a_joint_that_sticks_do_not_leave_the_bias_of_smooth_friction(monkeypatch):
    assert farthest() < 4.0
    monkeypatch.setattr(FrictionBias, "excess", lambda self, inverse: np.zeros_like(inverse))
    assert farthest() > 4.5


def test_what_is_still_known_after_a_change_keeps_its_bias():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((3, 6))
    matrix = root @ root.T
    effect = SummedEffect(np.full(3, 100.0))
    effect.add(rng.standard_normal(3), 0.0, 60.0)
    effect._squares[:] = 0.0  # no scatter
    bias = FrictionBias(effect)
    inverse = np.linalg.inv(matrix)
    before = bias.excess(inverse)
    known = np.diag([1.0, 2.0, 1e-9])
    bias = bias.changed([2], inverse, known)
    after = bias.excess(np.linalg.inv(known))
    np.testing.assert_allclose(after[:2, :2], before[:2, :2], rtol=1e-6)
    np.testing.assert_allclose(after[2], 0.0, atol=1e-12)
