"""Velocities that are inputs run along curves between their samples, not along straight lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import build
from joint_id_core.models.curved_inputs import curved, last_rates
from joint_id_core.online.curved_stream import CurvedStream
from joint_id_core.simulation import simulator
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick

MODEL = build("motor_side")
LINK = ("link_position", "link_velocity")


def link_motion(time, fastest=10.0):
    """Position and velocity of a link that moves up to `fastest` Hz, exact at every instant."""
    w = 2.0 * np.pi * np.array([1.0, 0.4 * fastest, fastest])
    amplitude, phase = np.array([0.3, 0.02, 0.004]), np.array([0.3, 1.0, 2.0])
    at = w * time[:, None] + phase
    return np.sin(at) @ amplitude, np.cos(at) @ (w * amplitude)


def recorded(rate, seconds=8.0, finer=16):
    """A motor whose link moves along a curve, recorded at a rate in Hz; noise-free, no friction that is not smooth."""
    time = np.arange(round(seconds * rate) * finer + 1) / (rate * finer)
    torque = np.repeat(multisine(time[::finer], 0.3, (0.5, 3.0, 7.0), seed=3), finer)[: len(time)]
    inputs = dict(zip(LINK, link_motion(time), strict=True)) | {"torque": torque}
    moved = simulate(MODEL, time, inputs, {"tau_fm": 0.0})
    return Recording(time[::finer], {name: moved[name][::finer] for name in (*MODEL.state_names, *MODEL.input_names)})


def test_which_inputs_are_the_last_derivative():
    assert [MODEL.input_names[i] for i in last_rates(MODEL)] == ["link_velocity"]
    delayed = build("motor_side", delays=True)
    assert [delayed.input_names[i] for i in last_rates(delayed)] == ["link_acceleration"]
    assert not len(last_rates(build("harmonic_drive")))


@pytest.mark.parametrize("rate, share", first_quick([(125, 0.5), (250, 0.3), (500, 0.15)]))
def test_a_motor_moves_as_it_did_between_the_samples_of_its_link(rate, share, monkeypatch):
    """The error falls with the third power of the step, that of straight lines with the second."""
    truth, settled = recorded(rate, 4.0), 2 * rate
    inputs = {name: truth[name] for name in MODEL.input_names}

    def off():
        found = simulate(MODEL, truth.time, inputs, {"tau_fm": 0.0})
        return np.std((found["motor_velocity"] - truth["motor_velocity"])[settled:])

    curves = off()
    monkeypatch.setattr(simulator, "curved", lambda model, time, u: u)
    assert curves < share * off()


@pytest.mark.long
def test_damping_of_the_gear_is_right_at_a_low_rate():
    """With straight lines it was 0.6 % too small."""
    found = fit(MODEL, recorded(250).window(2.0, 8.0), ParameterSettings({"tau_fm": 0.0}, fixed=("tau_fm",)))
    assert found["c_1"].value == pytest.approx(18.938, rel=0.002)


def test_a_parabola_has_its_mean():
    time = np.arange(20) / 250.0
    v = 3.0 * time**2 - time + 1.0
    u = np.column_stack([np.zeros(20), np.zeros(20), v])
    found = curved(MODEL, time, u)[:, 2]
    np.testing.assert_array_equal(curved(MODEL, time, u)[:, :2], u[:, :2])
    whole = (time**3 - 0.5 * time**2 + time)[[3, -1]]
    np.testing.assert_allclose(np.trapezoid(found[3:], time[3:]), whole[1] - whole[0], rtol=1e-12)


def test_across_gaps_and_missing_samples_a_velocity_stays_as_it_is():
    time = np.delete(np.arange(30), [10, 11]) / 100.0
    u = np.random.default_rng(0).normal(size=(28, 3))
    u[20, 2] = np.nan
    found = curved(MODEL, time, u)[:, 2]
    same = np.flatnonzero(found == u[:, 2])
    assert set(same) == {0, 1, 10, 11, 21, 22} and np.isnan(found[20])
    assert curved(MODEL, time[:2], u[:2]) is not None


@given(st.lists(st.integers(1, 9), min_size=1, max_size=8), st.integers(2, 6), st.integers(0, 1000))
def test_in_batches_it_is_the_same(sizes, before, seed):
    count = before + sum(sizes)
    rng = np.random.default_rng(seed)
    time, u = np.arange(count) / 500.0, rng.normal(size=(count, 3))
    whole = curved(MODEL, time, u)
    first = Recording(time[:before], dict(zip(MODEL.input_names, u[:before].T, strict=True)))
    stream, at = CurvedStream(MODEL, first), before
    for size in sizes:
        signals = np.vstack([u[at : at + size].T, np.ones((2, size))])
        stream.take(time[at : at + size], signals)
        np.testing.assert_allclose(signals[:3], whole[at : at + size].T, rtol=1e-12)
        np.testing.assert_array_equal(signals[3:], 1.0)
        at += size
