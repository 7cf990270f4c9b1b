"""Sensors that are late or off: the same joint, seen through a delay, an offset or a drive of unknown gain."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from joint_id_core.cell.kernel import compile_model
from joint_id_core.checking.findings import findings
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations import input_noise
from joint_id_core.estimators.shared.data_check import concerning
from joint_id_core.models import build
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.simulator import simulate

from .quick import first_quick

RATE, SAMPLES, FINE = 250, 1000, 4
PLAIN, LATE = build("harmonic_drive"), build("harmonic_drive", delays=True)
TRUTH = PLAIN.values()
NOISE = {"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3}
UR = ("link_position", "motor_velocity")
POSITIONS = ("link_position", "motor_position")


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


@pytest.mark.parametrize("labels", first_quick([(PLAIN.state_names,), (UR,)]), ids=["all", "ur"])
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
    monkeypatch.setattr(input_noise, "effect_on_score", lambda *args: np.full(len(args[-1].gradient), 1e12))
    estimate = fit(build("motor_side"), seen(labels=UR))
    assert np.isfinite([p.value for p in estimate.parameters]).all()
    assert np.isfinite(estimate.covariance).all()


def gear(offset: float = 0.0) -> Recording:
    time = np.arange(2000) / 500
    link = 0.4 + 0.3 * np.sin(3.0 * time)
    motor = 101.0 * (link + offset + 1e-3 * np.cos(3.0 * time))
    return Recording(time, {"motor_position": motor, "link_position": link, "torque": 0.1 * np.cos(3.0 * time)})


def test_encoders_with_different_zeros_are_named_unless_the_model_has_an_offset():
    assert not findings(gear())
    (found,) = findings(gear(-0.35))
    assert "differ by -0.35 rad throughout, beside the gear ratio of 101" in found.text
    assert concerning(PLAIN, gear(-0.35)) and not concerning(build("harmonic_drive", offsets=True), gear(-0.35))


def stopped(first, last):
    def change(values, _):
        values[first:last] = values[first]
        return values

    return change


FAULTS = {
    "different zeros": ("link_position", lambda q, _: q + 0.02, POSITIONS, "differ by -0.02"),
    "drift": ("link_position", lambda q, t: q + 0.005 * t, POSITIONS, "drift apart by -0.0"),
    "link froze for good": (
        "link_position", stopped(350, 990), POSITIONS,
        "link_position stands still in samples 350 to 989 (1.44 to 3.996 s) while motor_position shows motion",
    ),
    "motor froze from the start": (
        "motor_position", stopped(0, 400), POSITIONS, "motor_position stands still in samples 0 to 399",
    ),
    "motor velocity froze": (
        "motor_velocity", stopped(500, 560), PLAIN.state_names, "motor_velocity stands still in samples 500 to 559",
    ),
    "motor velocity froze for good": (
        "motor_velocity", stopped(700, 990), UR, "motor_velocity stands still in samples 700 to 989",
    ),
    "link is constant": (
        "link_position", lambda q, _: 0.0 * q, POSITIONS, "link_position is 0 in all samples while motor_position",
    ),
    "motor is constant": (
        "motor_position", lambda q, _: 0.0 * q, POSITIONS, "motor_position is 0 in all samples while link_position",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "change", "labels", "what"), FAULTS.values(), ids=list(FAULTS))
def test_encoders_that_contradict_each_other_are_named(name, change, labels, what):
    record = seen(labels=labels)
    (found,) = findings(record.with_channels({name: change(record[name].copy(), record.time)}))
    assert what in found.text and found.fatal is ("in all samples" in what)


@pytest.mark.parametrize("labels", [PLAIN.state_names, POSITIONS, UR], ids=["all", "positions", "ur"])
def test_good_encoders_raise_no_doubt(labels):
    assert not findings(seen(labels=labels))


def test_a_link_that_is_held_while_the_motor_twists_the_gear_is_no_fault():
    time = np.arange(2000) / 500
    motor = 101.0 * 5e-3 * np.sin(20.0 * time)
    held = {"motor_position": motor, "link_position": np.full(2000, 0.7), "torque": 0.2 * np.sin(20.0 * time)}
    assert not findings(Recording(time, held))


def test_tiny_values_of_all_channels_are_no_error():
    assert not findings(Recording(seen().time, {n: 1e-200 * x for n, x in seen().channels.items()}))
