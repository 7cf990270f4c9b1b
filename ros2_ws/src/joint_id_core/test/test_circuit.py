"""Signs, columns and units of a motor's electrical signals are checked against its circuit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid
from scipy.signal import cont2discrete, dlsim

from joint_id_core.checking.circuit import circuit
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators import fit
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation import simulate_motion
from joint_id_core.simulation.excitation import harmonics, multisine

from .examples import TIMES

MODEL = build("dc_motor")
RPM = 30.0 / np.pi


@pytest.fixture(scope="module")
def good() -> Recording:
    return simulate_motion(MODEL)


def changed(recording: Recording, channels: Mapping[str, Array]) -> Recording:
    return Recording(recording.time, {**recording.channels, **channels})


WRONG = {
    "current": (lambda r: {"current": -r["current"]}, "current has the wrong sign"),
    "voltage": (lambda r: {"voltage": -r["voltage"]}, "voltage has the wrong sign"),
    "velocity": (lambda r: {"motor_velocity": -r["motor_velocity"]}, "motor_velocity has the wrong sign"),
    "columns": (lambda r: {"current": r["voltage"], "voltage": r["current"]}, "or voltage and current are swapped"),
    "mA": (lambda r: {"current": 1e3 * r["current"]}, "current seems to be in ma"),
    "mV": (lambda r: {"voltage": 1e3 * r["voltage"]}, "voltage seems to be in mv"),
}


@pytest.mark.parametrize(("change", "told"), WRONG.values(), ids=list(WRONG))
def test_what_contradicts_the_circuit_is_refused_and_named(good, change, told):
    (found,) = circuit(changed(good, change(good)))
    assert found.fatal and told in found.text.lower() and "(--map)" in found.text
    estimate = fit(MODEL, changed(good, change(good)))
    assert estimate.status is Status.BAD_DATA and told in estimate.message.lower()


@settings(max_examples=20 * TIMES, deadline=None)
@given(
    st.floats(0.05, 5.0), st.floats(0.02, 0.5), st.floats(1e-5, 1e-3), st.floats(1.0, 40.0),
    st.integers(0, 99), st.floats(0.0, 0.2),
)  # fmt: skip
def test_no_motor_is_refused(resistance, constant, inertia, volts, seed, noise):
    time = np.arange(3000) / 500.0
    voltage = multisine(time, volts, harmonics(0.5, 10.0, 2.0), seed)
    inductance = 1e-3 * resistance
    dynamics = np.array([[-resistance / inductance, -constant / inductance], [constant / inertia, -1e-3]])
    drive = np.array([[1.0 / inductance], [0.0]])
    held = cont2discrete((dynamics, drive, np.eye(2), np.zeros((2, 1))), 1.0 / 500.0)
    motion = dlsim(held, voltage, time)[1]
    channels = {"voltage": voltage, "current": motion[:, 0], "motor_velocity": motion[:, 1]}
    rng = np.random.default_rng(seed)
    noisy = {n: v + noise * np.std(v) * rng.standard_normal(len(v)) for n, v in channels.items()}
    assert not list(circuit(Recording(time, noisy)))


def test_a_velocity_in_revolutions_a_minute_is_named(good):
    estimate = fit(MODEL, changed(good, {"motor_velocity": RPM * good["motor_velocity"]}))
    assert "motor_velocity seems to be in revolutions a minute" in estimate.message
    assert "held J_r is that of another motor" in estimate.message
    assert "in SI units" not in fit(MODEL, good).message
    of_another = fit(build("dc_motor"), changed(good, {"motor_velocity": 4.0 * good["motor_velocity"]})).message
    assert "in SI units they are one number for any motor: a channel is not in SI units" in of_another


@pytest.mark.long
def test_an_encoder_that_the_model_does_not_read_is_told_where_it_would_help():
    """Voltage and current alone leave k_b and k_t open; the derivative of the angle tells them apart."""
    rest = simulate_motion(MODEL)
    angle = cumulative_trapezoid(rest["motor_velocity"], rest.time, initial=0.0)
    both = changed(rest, {"motor_position": angle})
    alone = Recording(both.time, {n: v for n, v in both.channels.items() if n != "motor_velocity"})
    told = "motor_position is not used, as dc_motor has no angle: give its derivative as motor_velocity"
    assert told.capitalize() in " ".join(fit(MODEL, alone).notes)
    assert "is not used" not in " ".join(fit(MODEL, both).notes)


def test_samples_that_stand_or_are_missing_tell_nothing(good):
    still = changed(good, {"voltage": np.zeros(len(good)), "current": np.zeros(len(good))})
    gone = changed(good, {"voltage": np.full(len(good), np.nan)})
    assert not list(circuit(still)) and not list(circuit(gone))


@pytest.mark.parametrize(("change", "told"), WRONG.values(), ids=list(WRONG))
def test_a_short_recording_whose_voltage_rests_in_between_shows_it_as_well(change, told):
    short = simulate_motion(MODEL, duration=3.0, values={"R": 0.7, "k_t": 0.045, "c_b": 4e-4})
    assert not list(circuit(short))
    (found,) = circuit(changed(short, change(short)))
    assert found.fatal and told in found.text.lower()


def test_a_fit_whose_matrix_has_no_inverse_ends_with_a_status():
    """The channels are swapped: at the end of some searches rounding hides what the data say."""
    motion = simulate_motion(MODEL, duration=4.0)
    swapped = changed(motion, {"current": motion["motor_velocity"], "motor_velocity": motion["current"]})
    assert fit(MODEL, swapped).message
