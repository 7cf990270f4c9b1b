"""A memory whose samples hardly tell one combination of parameters: how far the others bend along it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier
from joint_id_core.online.curvature import NOTHING, curvature
from joint_id_core.online.memory import Memory
from joint_id_core.online.piece import Piece, Samples, State
from joint_id_core.results.estimate import Verdict
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate

WEAK, FIRM = 0.2, 1e-3  # standard deviations
COORDINATES = SimpleNamespace(unit=np.ones(2), clip=lambda z: z)


class Bent:
    """Stands for a filter over samples that show z_0 badly, and z_1 + bend z_0^2 well; both are zero."""

    def __init__(self, bend: float) -> None:
        self.bend = bend

    def piece(self, z):
        s = np.array([[1.0 / WEAK, 0.0], [2.0 * self.bend * z[0] / FIRM, 1.0 / FIRM]])
        r = -np.array([z[0] / WEAK, (z[1] + self.bend * z[0] ** 2) / FIRM])
        samples = Samples(np.array([0.5]), np.zeros((1, 1)), np.zeros((1, 1)))
        begin = State(np.zeros((1, 1)), 0.0, np.zeros(1))
        return Piece(s.T @ s, s.T @ r + s.T @ s @ z, np.zeros((1, 1)), begin, samples, z, 1.0, np.ones(1))

    def again(self, blocks, z):
        return np.zeros(1), [self.piece(z)]


@pytest.mark.parametrize("bend", [0.0, 0.1, -0.1])
def test_the_second_order_of_a_parabola(bend):
    """The mean of (bend z_0^2)^2 is 3 bend^2 WEAK^4."""
    tracker = Bent(bend)
    memory = Memory(np.zeros(2), np.diag([1e6, 1e6]), np.full(2, 1e3))
    memory.add(tracker.piece(np.zeros(2)), 1e9)
    found = curvature(tracker, memory, COORDINATES, 1e9)
    np.testing.assert_allclose(np.sqrt(found[1, 1]), np.sqrt(3.0) * abs(bend) * WEAK**2, rtol=0.1, atol=1e-9)
    assert np.sqrt(found[0, 0]) < 0.1 * WEAK


def test_a_bend_beyond_all_bounds_says_that_nothing_is_known():
    tracker = Bent(1e9)
    memory = Memory(np.zeros(2), np.diag([1e6, 1e6]), np.full(2, 1e3))
    memory.add(tracker.piece(np.zeros(2)), 1e9)
    found = curvature(tracker, memory, COORDINATES, 1e9)
    assert np.isfinite(found).all() and np.sqrt(found[1, 1]) > NOTHING


def test_a_memory_that_knows_everything_well_is_as_good_as_linear():
    tracker = Bent(1.0)
    memory = Memory(np.zeros(2), np.diag([1e-4, 1e-4]), np.full(2, 1e3))
    memory.add(tracker.piece(np.zeros(2)), 1e9)
    assert not curvature(tracker, memory, COORDINATES, 1e9).any()


@pytest.mark.long
def test_after_a_change_of_the_load_a_common_scale_that_was_hardly_known_is_not_known_better():
    """A slow joint under a voltage: torques and inertias are known only together, to several percent."""
    model, rate, before_s, after_s = build("electromechanical"), 500, 8.0, 6.0
    true, first, count = model.values(), round(before_s * rate), round((before_s + after_s) * rate)
    heavier, rng = {**true, "J_q": 2.0 * true["J_q"]}, np.random.default_rng(0)
    time = np.arange(count + 1) / rate
    voltage = multisine(time, 8.0, (0.15, 0.4), seed=0)
    drive = voltage + 0.03 * rng.standard_normal(count + 1)
    light = simulate(model, time[: first + 1], {"voltage": drive[: first + 1]})
    end = {name: float(light[name][-1]) for name in model.state_names}
    heavy = simulate(model, time[first:] - time[first], {"voltage": drive[first:]}, heavier, end)
    noise = {"current": 0.05, "link_position": 1e-5, "motor_velocity": 0.1}
    seen = {
        name: np.concatenate([light[name][:-1], heavy[name][:-1]]) + sigma * rng.standard_normal(count)
        for name, sigma in noise.items()
    }
    recording = Recording(time[:-1], {**seen, "voltage": voltage[:-1]})
    identifier, judged = OnlineIdentifier(model, ParameterSettings(freed=("J_q",))), 0
    for k in range(0, count, 25):
        estimate = identifier.update(recording.slice(k, k + 25))
        if estimate is None or not estimate.converged or estimate.end < before_s + 1.5:
            continue
        judged += 1
        for row in estimate.parameters:
            if row.verdict is Verdict.ESTIMATED:
                assert abs(row.value - heavier[row.name]) < 4.0 * row.std_dev, f"{row.name} at {estimate.end} s"
    assert judged >= 5
