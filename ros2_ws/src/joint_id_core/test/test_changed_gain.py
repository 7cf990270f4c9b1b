"""A torque whose gain changes within a recording, and a burst of noise, are named."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.checking.burst import bursts
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, ParameterSettings, Regression, fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation import simulate_motion

from .quick import first_quick

MODEL = build("rigid_joint")
AT = 3.5  # s


@pytest.fixture(scope="module")
def good() -> Recording:
    return simulate_motion(MODEL, duration=6.0)


@pytest.mark.parametrize("estimator", [Innovations(), Regression()], ids=["innovations", "regression"])
@pytest.mark.parametrize("factor", first_quick([0.9, 1.3]))
def test_the_instant_and_the_factor_are_told(good, estimator, factor):
    assert fit(MODEL, good, estimator=estimator).status is Status.CONVERGED
    changed = good.with_channels({"torque": good["torque"] * np.where(good.time > AT, factor, 1.0)})
    found = fit(MODEL, changed, estimator=estimator)
    assert found.status is Status.POOR_FIT and "the gain of the drive changed there" in found.message
    words = found.message.split()
    assert float(words[1]) == pytest.approx(AT, abs=0.25)
    assert float(words[words.index("times") - 1]) == pytest.approx(factor, abs=0.02)


@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(1, 5), marks=pytest.mark.long)], ids=["one", "more"])
def test_good_recordings_have_no_change_and_no_burst(seeds):
    rng = np.random.default_rng(1)
    for seed in seeds:
        for friction in ("coulomb_viscous", "stribeck", "eyring"):
            recording = simulate_motion(build("rigid_joint", friction=friction), rng.uniform(3.0, 8.0), seed=seed)
            assert "the gain of the drive" not in fit(MODEL, recording, estimator=Regression()).message
            assert not list(bursts(recording))


@pytest.mark.parametrize("name", ["torque", "link_position"])
def test_a_burst_of_noise_is_named_with_its_samples(good, name):
    assert not list(bursts(good))
    noise = np.zeros(len(good))
    noise[800:1000] = 0.3 * np.std(good[name]) * np.random.default_rng(0).standard_normal(200)
    (found,) = bursts(good.with_channels({name: good[name] + noise}))
    first, last = found.samples
    assert abs(first - 800) <= 25 and abs(last - 999) <= 25 and not found.fatal
    assert name in found.text and "times as noisy as elsewhere" in found.text


def test_a_motion_that_begins_and_a_drive_in_steps_are_no_bursts(good):
    begun = np.clip((good.time - 2.0) / 0.05, 0.0, 1.0)
    late = {
        n: v[0] + begun * (v - v[0]) + 1e-6 * np.random.default_rng(2).standard_normal(len(v))
        for n, v in good.channels.items()
    }
    assert not list(bursts(good.with_channels(late)))
    steps = np.where(np.sin(3.0 * good.time) > 0.0, 5.0, -5.0)
    assert not list(bursts(good.with_channels({"torque": steps})))


@pytest.mark.parametrize(
    ("without", "says"), first_quick([("", "The torque is "), ("link_position", "The drive seems to be ")])
)
def test_a_late_drive_of_a_flexible_joint_is_named(without, says):
    model = build("harmonic_drive")
    recording = simulate_motion(model, duration=3.0)
    late = np.interp(recording.time - 0.02, recording.time, recording["torque"])
    channels = {n: v for n, v in {**recording.channels, "torque": late}.items() if n != without}
    found = fit(model, Recording(recording.time, channels), ParameterSettings(priors={"k_1": 0.1} if without else {}))
    assert found.status is Status.POOR_FIT
    told = found.message.split(says)[1].split()
    assert float(told[0]) == pytest.approx(20.0, abs=1.5) and told[2] == "late"
