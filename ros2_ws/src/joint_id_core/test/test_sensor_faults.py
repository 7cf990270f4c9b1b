"""Sensors that are late or off: the same joint, seen through a delay, an offset or a drive of unknown gain."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations import input_noise
from joint_id_core.models import build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.simulator import simulate

RATE, SAMPLES, FINE = 250, 1000, 4
PLAIN, LATE = build("harmonic_drive"), build("harmonic_drive", delays=True)
TRUTH = PLAIN.values()
NOISE = {"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3}
UR = ("link_position", "motor_velocity")


@functools.cache
def motion():
    """Four seconds of Model 2 at 250 Hz, its states every millisecond, and the torque that is reported."""
    time = np.arange(SAMPLES) / RATE
    loop = simulate_closed_loop(PLAIN, PositionController(k_p=6.0, k_d=0.4), position_reference(), time)
    torque = loop["torque"] + 0.003 * np.random.default_rng(1).standard_normal(SAMPLES)
    fine = np.arange(FINE * SAMPLES) / (FINE * RATE)
    start = {name: float(loop[name][0]) for name in PLAIN.state_names}
    return simulate(PLAIN, fine, {"torque": np.repeat(torque, FINE)}, x0=start), loop["torque"]


def seen(link_ms=0, encoders_ms=0, labels=PLAIN.state_names, gain=1.0, torque_offset=0.0, twist_offset=0.0):
    """What sensors show that are late by whole milliseconds, with the torque scaled and shifted."""
    states, torque = motion()
    rng = np.random.default_rng(2)
    at = np.arange(10 * FINE, FINE * SAMPLES, FINE)
    channels = {"torque": (torque * gain + torque_offset)[10:]}
    for name in labels:
        late = encoders_ms + (link_ms if name.startswith("link") else 0)
        channels[name] = states[name][at - late] + NOISE[name] * rng.standard_normal(len(at))
    if "link_position" in channels:
        channels["link_position"] = channels["link_position"] - twist_offset
    return Recording(np.arange(10, SAMPLES) / RATE, channels)


@pytest.mark.parametrize("labels", [PLAIN.state_names, UR], ids=["all", "ur"])
def test_three_milliseconds_between_the_encoders_are_found_to_a_tenth(labels):
    record = seen(link_ms=3, labels=labels)
    estimate = fit(LATE, record)
    assert estimate.converged, estimate.message
    assert estimate["delta_q"].value == pytest.approx(3e-3, abs=1e-4)
    assert estimate["delta_p"].value == pytest.approx(0.0, abs=1e-4)
    for name in ("J_m", "k_1", "J_q"):
        assert estimate[name].value == pytest.approx(TRUTH[name], rel=0.03), name
    ignored = fit(PLAIN, record)
    assert ignored["k_1"].value < 0.5 * TRUTH["k_1"]  # the skew hides the stiffness altogether
    assert not ignored.converged


def test_an_early_link_encoder_and_a_late_drive():
    estimate = fit(LATE, seen(link_ms=-2, encoders_ms=3, labels=UR))
    assert estimate["delta_q"].value == pytest.approx(-2e-3, abs=1e-4)
    assert estimate["delta_p"].value == pytest.approx(3e-3, abs=2e-4)


def test_without_delay_the_wider_model_says_so():
    estimate = fit(LATE, seen())
    assert estimate.converged, estimate.message
    for name in ("delta_p", "delta_q"):
        assert abs(estimate[name].value) < 4.0 * estimate[name].std_dev < 2e-4, name


def test_delay_of_the_motor_side_whose_input_is_the_late_signal():
    """The motor alone, with the link as an input: the same delay, from the velocity of the motor."""
    model = build("motor_side", delays=True)
    record = seen(link_ms=3, labels=("link_position", "link_velocity", "motor_velocity"))
    estimate = fit(model, record, ParameterSettings({"k_2": TRUTH["k_2"]}))
    assert estimate.converged, estimate.message
    assert estimate["delta_q"].value == pytest.approx(3e-3, abs=1e-4)
    assert estimate["k_1"].value == pytest.approx(TRUTH["k_1"], rel=0.1)


def test_what_late_sensors_show_is_the_state_of_then():
    """The compiled observation against the simulated motion, which stands for the truth."""
    states, _ = motion()
    kernel = compile_model(LATE)
    values = LATE.values({"delta_p": 1e-3, "delta_q": 2e-3})
    p = np.array([values[n] for n in LATE.parameter_names])
    at = np.arange(50 * FINE, FINE * SAMPLES, FINE)
    X = np.column_stack([states[n][at] for n in LATE.state_names])
    u = np.column_stack([states["torque"][at], np.zeros(len(at))])
    Y = np.empty_like(X)
    kernel.module.observations(X, u, p, Y)
    for i, name in enumerate(LATE.state_names):
        late = 3 if name.startswith("link") else 1
        error = Y[:, i] - states[name][at - late]
        ignored = X[:, i] - states[name][at - late]
        assert np.sqrt(np.mean(error**2)) < 0.05 * np.sqrt(np.mean(ignored**2)), name


def test_offsets_of_torque_and_twist_are_found():
    model = build("harmonic_drive", offsets=True)
    estimate = fit(model, seen(torque_offset=0.02, twist_offset=5e-4))
    assert estimate.converged, estimate.message
    assert estimate["tau_0"].value == pytest.approx(0.02, abs=4.0 * estimate["tau_0"].std_dev)
    assert estimate["dtheta_0"].value == pytest.approx(5e-4, abs=4.0 * estimate["dtheta_0"].std_dev)
    assert estimate["tau_0"].std_dev < 2e-3 and estimate["dtheta_0"].std_dev < 1e-4
    assert abs(estimate["k_1"].value - TRUTH["k_1"]) < 4.0 * estimate["k_1"].std_dev


def test_the_prior_of_the_drive_gain_is_in_every_interval():
    """A torque constant known to 5 % gives inertias and stiffnesses that are known to 5 %."""
    record = seen()
    amperes = record.with_channels({"current": record["torque"] / 0.1})
    amperes = Recording(amperes.time, {n: v for n, v in amperes.channels.items() if n != "torque"})
    model = build("harmonic_drive", actuation="current")
    held = fit(model, amperes, ParameterSettings({"k_t": 0.1}))
    free = fit(model, amperes, ParameterSettings({"k_t": 0.1}, freed=("k_t",), priors={"k_t": 0.05}))
    assert "the common scale of J_m" in free["k_t"].reason
    for name in ("J_m", "k_1", "J_q"):
        assert held[name].std_dev < 0.01 * held[name].value
        assert free[name].std_dev == pytest.approx(0.05 * free[name].value, rel=0.05), name
        assert free[name].value == pytest.approx(held[name].value, rel=0.02), name


@pytest.mark.parametrize(
    ("priors", "words"), [({"k_1": -1.0}, "above zero"), ({"N": 0.1}, "free it"), ({"x": 1.0}, "no parameter")]
)
def test_priors_that_make_no_sense_are_refused(priors, words):
    with pytest.raises(JointIdError, match=words):
        fit(PLAIN, seen(), ParameterSettings(priors=priors))


def test_noise_of_the_link_that_would_explain_everything_gives_no_infinite_values(monkeypatch):
    """As with an encoder that is late in ordinary motion: the bias that would be taken off is beyond all numbers."""
    monkeypatch.setattr(input_noise, "attenuation", lambda _, __, found, *___: np.full(len(found.z), 1e12))
    estimate = fit(build("motor_side"), seen(labels=UR))
    assert np.isfinite([p.value for p in estimate.parameters]).all()
    assert np.isfinite(estimate.covariance).all()
