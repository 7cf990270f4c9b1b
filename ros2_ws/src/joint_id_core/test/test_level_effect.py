"""Intervals contain that noise levels are estimates, too: against Student's distribution, and on short records."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri, stdtrit

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import fit
from joint_id_core.models import build
from joint_id_core.online import OnlineIdentifier, OnlineOptions
from joint_id_core.online.levels import MOVED, SHOWN
from joint_id_core.results.level_effect import LevelEffect
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate

MODEL = build("rigid_joint")
TRUTH = {"J": 2.0, "c": 8.0, "tau_f": 3.0, "tau_0": 0.7}
RATE, SECONDS = 500, 2.0
POSITION, TORQUE = 2e-5, 0.05  # standard deviations of the sensors, rad and Nm
SLIGHT = 0.1  # of the noise of the torque: the encoder then hides it in most records


@given(count=st.integers(40, 1000), parameters=st.integers(1, 8))
def test_with_one_level_the_interval_is_that_of_student(count, parameters):
    """Linear regression: the likelihood divides by the samples, and the level acts on all variances alike."""
    information = np.array([0.5 * count])
    effect = LevelEffect(np.ones((parameters, 1)), np.array([0.5 * parameters]), np.zeros((parameters, 1)), information)
    free = count - parameters
    exact = np.sqrt(count / free) * stdtrit(free, 0.975) / ndtri(0.975)
    wider = effect.wider(np.diag(1.0 / information), information)
    np.testing.assert_allclose(wider - 1.0, exact - 1.0, rtol=0.35, atol=1e-4)
    corrected = effect.wider(np.diag(1.0 / information), information, corrected=True)
    np.testing.assert_allclose(corrected, stdtrit(count, 0.975) / ndtri(0.975), rtol=1e-9)


def test_tails_are_those_of_student():
    effect = LevelEffect(np.eye(2), np.zeros(2), np.zeros((2, 2)), np.ones(2))
    tails = effect.tails(np.diag([0.2, 1e-9]), 1.0 - 5e-8)
    np.testing.assert_allclose(tails, [stdtrit(10.0, 1.0 - 5e-8) / ndtri(1.0 - 5e-8), 1.0], rtol=1e-4)


def test_what_a_record_only_limits_counts_less_with_more_samples():
    effect = LevelEffect(np.zeros((2, 1)), np.zeros(1), np.full((2, 1), 0.4), np.array([0.1]))
    factors = [effect.wider(np.eye(1), np.array([many * 0.1]))[0] for many in (1.0, 4.0, 100.0)]
    np.testing.assert_allclose(np.log(factors), [0.4, 0.2, 0.04], rtol=1e-4)


@functools.cache
def exact() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Instants, positions and torques of a joint that a multisine moves, after it has settled."""
    time = np.arange(round(30.0 * RATE)) / RATE
    torque = multisine(time, 60.0, (0.5, 1.0, 1.5, 2.5, 4.0, 6.0), seed=1)
    return time, simulate(MODEL, time, {"torque": torque}, TRUTH)["link_position"], torque


def record(seed: int, torque_noise: float, seconds: float = SECONDS) -> Recording:
    """What sensors show of a part that begins anywhere."""
    time, position, torque = exact()
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE)
    rows = slice(begin := int(rng.integers(5 * RATE, 15 * RATE)), begin + count)
    noise = rng.standard_normal((2, count))
    channels = {"link_position": position[rows] + POSITION * noise[0], "torque": torque[rows] + torque_noise * noise[1]}
    return Recording(time[rows], channels, source="short")


def scores(estimates) -> np.ndarray:
    """Errors over standard deviations, a row an estimate."""
    return np.array([[(e[n].value - TRUTH[n]) / e[n].std_dev for n in e.free] for e in estimates])


@pytest.mark.long
@pytest.mark.parametrize("torque_noise, seconds", [(TORQUE, 1.5), (SLIGHT * TORQUE, SECONDS)])
def test_intervals_of_short_records_hold_although_noise_levels_are_hardly_known(torque_noise, seconds, monkeypatch):
    """The noise of the torque comes out anywhere between zero and twice of what it is."""
    records = [record(seed, torque_noise, seconds) for seed in range(40)]
    z = scores([fit(MODEL, each) for each in records])
    assert np.mean(np.abs(z) < 1.96) > 0.88
    assert np.sqrt(np.mean(z**2)) < 1.2
    assert np.abs(z).max() < 5.0
    monkeypatch.setattr(LevelEffect, "wider", lambda self, *_, **__: np.ones(len(self.slopes)))
    assert np.sqrt(np.mean(scores([fit(MODEL, each) for each in records]) ** 2)) > 1.25


def test_levels_that_a_record_shows_well_change_nothing():
    known = fit(MODEL, record(0, TORQUE, seconds=12.0))
    levels = known.checks.levels
    factors = levels.wider(np.diag(1.0 / np.maximum(levels.information, 1.0)), levels.information)
    assert factors.max() < 1.1


def test_online_blocks_pass_again_when_noise_levels_have_moved():
    """What a block tells is inversely proportional to the noise with which it passed."""
    whole = record(3, TORQUE, seconds=10.0)
    identifier = OnlineIdentifier(MODEL, None, OnlineOptions(window_s=2.0))
    for k in range(0, len(whole.time), 25):
        identifier.update(whole.slice(k, k + 25))
    follower = identifier._known.follower
    shown = np.diag(follower.levels._information) > SHOWN
    away = [np.abs(np.log(block.levels / follower.levels.values))[shown].max() for block in follower.memory.blocks[:-1]]
    assert len(away) > 10 and max(away) < 1.5 * MOVED  # a last step may still follow
