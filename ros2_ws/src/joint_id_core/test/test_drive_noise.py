"""Noise of a recorded drive: of its sensor, or of the drive itself?"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, fit
from joint_id_core.estimators.innovations.drive_noise import DriveNoise, drive_noise, mean_and_variance
from joint_id_core.estimators.innovations.search import Search
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.models import build
from joint_id_core.simulation.excitation import build_multisine
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick

MODEL = build("rigid_joint")
TRUTH = {"J": 2.0, "c": 6.0, "tau_f": 1.0}
TIME = np.arange(20 * 500) / 500
FINE, COARSE = 1e-6, 1e-4  # noise of the encoder in rad
NOISE_NM = 1.5
LEVELS = build_multisine(25.0, (0.3, 0.5, 0.8, 1.1, 1.7), seed=2).value(TIME)


def motion(of_sensor: bool, encoder: float, seed: int = 1) -> Recording:
    """A motion whose recorded torque is noisy: by its sensor, or as it acts, beside a load that is as noisy."""
    rng = np.random.default_rng(seed)
    noise, load = NOISE_NM * rng.standard_normal((2, len(TIME)))
    acting = LEVELS if of_sensor else LEVELS + noise + load
    seen = simulate(MODEL, TIME, {"torque": acting}, TRUTH)["link_position"]
    channels = {"torque": LEVELS + noise, "link_position": seen + encoder * rng.standard_normal(len(TIME))}
    return Recording(TIME, channels, source="noise")


def noise_of(recording: Recording) -> tuple[DriveNoise, np.ndarray]:
    """What is found of the noise, and the standard deviations (k,) of the coordinates without it."""
    data = prepare(MODEL, recording, None)
    outcome = Search(data, compile_model(MODEL, "tanh", data.freed, "rk4"), Innovations(), None, lambda _: None).cold()
    assert outcome is not None
    recursion, found = outcome.stages.recursion, outcome.minimum
    last = recursion.renewed(found.last)
    told = drive_noise(recursion, outcome.stages.coordinates, found, last)
    return told, np.sqrt(np.diag(found.covariance))


@pytest.mark.parametrize("seed", first_quick(range(1, 3)))
@pytest.mark.parametrize("encoder", first_quick([FINE, 1e-5, COARSE]))
def test_the_motion_tells_whether_noise_of_the_drive_moves_the_joint(encoder, seed):
    """The score of one test alone is zero, whatever the noise is, with an encoder of about 3e-5 rad."""
    for of_sensor, fraction in ((True, 1.0), (False, 0.0)):
        told, sigma = noise_of(motion(of_sensor, encoder, seed))
        assert told.of_all[0] > sigma[0], "of the inertia: what is at stake"
        assert told.fraction == pytest.approx(fraction, abs=max(0.1, 3.0 * np.sqrt(told.variance)))
        assert told.variance < 0.15**2


@pytest.mark.parametrize("encoder", first_quick([FINE, COARSE]))
@pytest.mark.parametrize("of_sensor", [True, False])
def test_intervals_contain_what_noise_of_the_sensor_does(of_sensor, encoder):
    """`J` was too large by 7 standard deviations."""
    found = fit(MODEL, motion(of_sensor, encoder))
    assert found.converged
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 3.0 * found[name].std_dev, name


@pytest.mark.long
def test_noise_that_moves_the_joint_costs_no_width():
    found = fit(MODEL, motion(False, FINE))
    _, sigma = noise_of(motion(False, FINE))
    assert found["J"].std_dev < 1.3 * sigma[0] * found["J"].value  # `sigma` is that of the logarithm


def test_a_drive_without_noise_is_in_no_doubt():
    seen = simulate(MODEL, TIME, {"torque": LEVELS}, TRUTH)["link_position"]
    noisy = seen + FINE * np.random.default_rng(0).standard_normal(len(TIME))
    told, sigma = noise_of(Recording(TIME, {"torque": LEVELS, "link_position": noisy}, source="exact"))
    assert (np.sqrt(np.diag(told.excess)) < 0.1 * sigma).all()


@given(st.floats(-1e9, 1e9), st.floats(0.0, 1e12))
def test_the_fraction_is_between_none_and_all(score, information):
    mean, variance = mean_and_variance(score, information)
    assert 0.0 <= mean <= 1.0 and 0.0 <= variance <= 0.25


@pytest.mark.parametrize(
    ("score", "information", "mean", "variance"),
    [(0.0, 0.0, 0.5, 1.0 / 12.0), (1e4, 1e4, 1.0, 0.0), (0.0, 1e4, 0.0, 0.0), (4e3, 1e4, 0.4, 1e-4)],
    ids=["nothing known", "all", "none", "known well"],
)
def test_the_fraction_is_that_of_what_is_known(score, information, mean, variance):
    found = mean_and_variance(score, information)
    assert found == (pytest.approx(mean, abs=0.01), pytest.approx(variance, abs=2e-4, rel=0.02))
