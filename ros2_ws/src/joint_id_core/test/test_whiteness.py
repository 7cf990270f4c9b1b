"""Residuals with a memory: found where they are, not where they are not, and counted in the intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from scipy.signal import lfilter

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.whiteness import LAGS, portmanteau
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import build
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

MODEL = build("rigid_joint")
TRUTH = MODEL.values()
PERIOD, SAMPLES = 2e-3, 1500


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    channels = {name: rng.standard_normal(SAMPLES) for name in (*MODEL.state_names, "torque")}
    recording = Recording(np.arange(SAMPLES) * PERIOD, channels)
    return prepare(MODEL, recording)


def test_white_residuals_give_the_statistic_its_distribution(data):
    """Probabilities of white noise are uniform (Kolmogorov and Smirnov)."""
    found = []
    for seed in range(150):
        residuals = np.random.default_rng(seed).standard_normal((SAMPLES, len(data.labels)))
        strength, probability = portmanteau(data, residuals)
        found.append(probability)
        assert np.all(np.abs(strength - 1.0) < 6.0 * np.sqrt(2.0 / LAGS))
    assert scipy.stats.kstest(np.ravel(found), "uniform").pvalue > 0.01


def test_a_faint_memory_is_found_in_the_label_that_has_it(data):
    rng = np.random.default_rng(1)
    residuals = rng.standard_normal((SAMPLES, len(data.labels)))
    residuals[:, 1] += 0.7 * lfilter([np.sqrt(1 - 0.95**2)], [1.0, -0.95], rng.standard_normal(SAMPLES))
    _, probability = portmanteau(data, residuals)
    assert probability[1] < 1e-12 < 1e-3 < probability[0]


def test_labels_that_are_missing_do_not_count(data):
    """Every second label of a white signal is still white; counted as zeros it would seem to alternate."""
    rng = np.random.default_rng(2)
    y = data.y.copy()
    y[::2, 0] = np.nan
    residuals = np.where(np.isfinite(y), rng.standard_normal(y.shape), 0.0)
    _, probability = portmanteau(replace(data, y=y), residuals)
    assert probability[0] > 1e-3


def motion(colour: float, seed: int) -> Recording:
    """A rigid joint under a torque with noise, of which a share is low-pass noise; the recorded torque is without."""
    rng = np.random.default_rng(seed)
    time = np.arange(SAMPLES) * PERIOD
    scale = 10.0 * TRUTH["tau_f"]
    drive = scale * (np.sin(2 * np.pi * 0.9 * time) + 0.5 * np.sin(2 * np.pi * 2.3 * time + 1.0))
    white, driven = rng.standard_normal((2, SAMPLES))
    unseen = 0.02 * scale * (white + colour * lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], driven))
    true = simulate(MODEL, time, {"torque": drive + unseen}, TRUTH).with_channels({"torque": drive})
    sensors = Sensors(noise={"link_position": 1e-5, "link_velocity": 1e-3})
    return sensors.measure(true, seed, keep=("link_position", "link_velocity", "torque"))


@pytest.mark.long
def test_coloured_torque_is_said_and_widens_the_intervals():
    """Over 25 draws: the sigma of white noise is far too small, with the memory most of the difference is counted."""
    errors, plain, said = [], [], 0
    for seed in range(25):
        estimate = fit(MODEL, motion(1.5, seed), ParameterSettings(TRUTH))
        assert any("not white" in note for note in estimate.notes), estimate.notes
        free = estimate.free
        std = np.array([estimate[n].std_dev for n in free])
        errors.append(np.array([estimate[n].value - TRUTH[n] for n in free]) / std)
        white = fit(MODEL, motion(0.0, seed), ParameterSettings(TRUTH))
        said += any("not white" in note for note in white.notes)
        plain.append(np.array([white[n].value - TRUTH[n] for n in free]) / [white[n].std_dev for n in free])
    assert said <= 2  # the joint sticks at each turn, which smoothed friction follows only nearly
    assert np.sqrt(np.mean(np.square(plain))) < 1.3
    assert np.sqrt(np.mean(np.square(errors))) < 1.6
