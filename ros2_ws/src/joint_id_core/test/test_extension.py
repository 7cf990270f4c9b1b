"""An estimate extended by later samples: the same as a fit of all of them, or none where they ask for more."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.models import build
from joint_id_core.online.extension import extend
from joint_id_core.online.identifier import OnlineIdentifier, OnlineOptions
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors

MODEL = build("harmonic_drive")
NOISE = {"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3}
UR = ("link_position", "motor_velocity")
RATE = 500


@functools.cache
def record(seed: int = 1, labels: tuple[str, ...] = tuple(NOISE), load: float = 1.0, seconds: int = 4) -> Recording:
    """Model 2 under position control with exact stick and slip, its load `load` times the nominal one."""
    motion = simulate_closed_loop(
        MODEL, PositionController(), position_reference(), np.arange(seconds * RATE) / RATE,
        {"J_q": load * MODEL.values()["J_q"]}, torque_noise=0.003, seed=seed,
    )  # fmt: skip
    return Sensors(noise=NOISE).measure(motion, seed, keep=(*labels, "torque"))


@functools.cache
def first(seed: int = 1, labels: tuple[str, ...] = tuple(NOISE)):
    """Estimate of the first two seconds."""
    return fit(MODEL, record(seed, labels).window(0.0, 2.0))


def extended(estimate, recording, inflation=1.0, **changes):
    return extend(
        **{"model": MODEL, "previous": estimate, "recording": recording, "settings": ParameterSettings()}
        | {"options": Innovations(), "inflation": inflation}
        | changes
    )


@pytest.mark.parametrize("labels", [tuple(NOISE), UR], ids=["all", "ur"])
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_it_is_the_fit_of_all_samples_together(seed, labels):
    """To first order, with the noise levels of before: those of the whole fit differ by a few percent."""
    recording, before = record(seed, labels), first(seed, labels)
    found = extended(before, recording.window(1.8, 2.4))
    assert found is not None and found.converged
    whole = fit(MODEL, recording.window(0.0, 2.4))
    for name in before.free:
        assert abs(found[name].value - whole[name].value) < 0.5 * whole[name].std_dev, name
        assert found[name].std_dev == pytest.approx(whole[name].std_dev, rel=0.15), name
        assert found[name].std_dev < before[name].std_dev, name


def test_many_small_steps_teach_what_one_fit_does():
    recording, estimate = record(), first()
    for end in np.arange(2.2, 4.01, 0.2):
        estimate = extended(estimate, recording.window(end - 0.4, end))
        assert estimate is not None
    whole = fit(MODEL, recording)
    for name in estimate.free:
        assert abs(estimate[name].value - whole[name].value) < 0.6 * whole[name].std_dev, name
        assert estimate[name].std_dev == pytest.approx(whole[name].std_dev, rel=0.15), name


def test_it_is_the_window_slid_to_the_new_samples():
    before, found = first(), extended(first(), record().window(1.8, 2.2))
    assert found.end == pytest.approx(before.end + 0.2)
    assert found.start == pytest.approx(before.start + 0.2)
    assert (found.samples, found.noise, found.nrmse) == (before.samples, before.noise, before.nrmse)
    assert found.predictions is None and found.iterations == 0


def test_what_is_forgotten_widens_the_intervals():
    later = record().window(1.8, 2.1)
    kept, forgotten = extended(first(), later), extended(first(), later, inflation=4.0)
    for name in first().free:
        assert 1.2 < forgotten[name].std_dev / kept[name].std_dev <= 2.0 + 1e-9, name


@pytest.mark.parametrize(
    "later",
    {
        "nothing new": lambda: record().window(1.0, 2.0),
        "another load": lambda: record(load=1.5).window(1.6, 2.6),
        "fewer labels": lambda: record(labels=UR).window(1.8, 2.2),
        "at rest": lambda: at_rest(),
        "a noisier sensor": lambda: noisier(),
        "no torque": lambda: Recording(
            record().time, {n: v for n, v in record().channels.items() if n != "torque"}
        ).window(1.8, 2.2),
    }.items(),
    ids=lambda item: item[0],
)
def test_samples_that_ask_for_a_fit_of_their_own(later):
    assert extended(first(), later[1]()) is None


def at_rest():
    window = record().window(1.8, 2.2)
    return replace(window, channels={n: np.full(len(window), v[0]) for n, v in window.channels.items()})


def noisier():
    window = record().window(1.8, 2.2)
    more = window["link_velocity"] + 3e-3 * np.random.default_rng(0).standard_normal(len(window))
    return window.with_channels({"link_velocity": more})


def test_an_estimate_that_was_not_tested_is_not_extended():
    assert extended(replace(first(), checks=None), record().window(1.8, 2.2)) is None


def test_misuse_is_an_error():
    with pytest.raises(JointIdError, match="no parameter 'k_9'"):
        extended(first(), record().window(1.8, 2.2), settings=ParameterSettings(fixed=("k_9",)))


def online(recording, **options):
    identifier = OnlineIdentifier(MODEL, options=OnlineOptions(**options))
    found = (identifier.update(recording.slice(k, k + 20)) for k in range(0, len(recording), 20))
    return [e for e in found if e is not None]


def test_a_window_is_fitted_as_a_whole_once_in_its_length():
    found = online(record(seconds=8), window_s=2.0, hop_s=0.2)
    whole = [e.end for e in found if e.predictions is not None]
    assert len(found) == 31
    np.testing.assert_allclose(np.diff(whole), 2.0, atol=0.01)


def test_without_memory_every_window_is_fitted_by_itself():
    assert all(e.predictions is not None for e in online(record(), window_s=2.0, hop_s=0.5, memory_s=0.0))


def test_a_joint_that_changes_is_fitted_at_once():
    """The load grows by half after 4 s, in the middle between two fits of a window, with a jump of the angle."""
    heavy = record(load=1.5)
    both = Recording(
        np.concatenate([record().time, heavy.time + 4.0]),
        {n: np.concatenate([v, heavy[n]]) for n, v in record().channels.items()},
    )
    found = online(both, window_s=2.5, hop_s=0.25)
    mixed = [e for e in found if 4.2 < e.end < 6.4]
    assert mixed and all(e.status is Status.POOR_FIT and e.predictions is not None for e in mixed)
    alone = next(e for e in found if e.end > 6.6)  # a window after the jump
    assert alone.converged and "The joint has changed: older windows are forgotten" in alone.message
    for estimate in (e for e in found if e.end > 6.6):
        assert estimate.converged
        assert abs(estimate["J_q"].value - heavy_load()) < 4.0 * estimate["J_q"].std_dev


def heavy_load():
    return 1.5 * MODEL.values()["J_q"]
