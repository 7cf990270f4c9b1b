"""The innovations estimator: what it finds, what it says of it, and what it refuses."""

from __future__ import annotations

import functools
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.innovations.verdicts import MAGNITUDE
from joint_id_core.models import build
from joint_id_core.results.estimate import Status, Verdict
from joint_id_core.simulation.excitation import multisine, position_reference
from joint_id_core.simulation.position_control import PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

HARMONIC = build("harmonic_drive")
RIGID = build("rigid_joint")
FREE = tuple(p.name for p in HARMONIC.parameters if not p.fixed)
TORQUE_NOISE = 0.003  # Nm at the motor
SENSORS = Sensors(noise={"motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3})
PARTIAL = ("link_position", "motor_velocity", "torque")
RIGID_TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}


@functools.cache
def closed_loop(seed: int) -> Recording:
    """Two seconds of Model 2 under position control with exact stick and slip, as its sensors see it."""
    motion = simulate_closed_loop(
        HARMONIC,
        PositionController(),
        position_reference(),
        np.arange(1000) / 500,
        torque_noise=TORQUE_NOISE,
        seed=seed,
    )
    return SENSORS.measure(motion, seed)


@functools.cache
def rigid(seed: int = 0) -> Recording:
    """Three seconds of a rigid joint with offset, driven by a multisine whose measurement is noisy."""
    rng = np.random.default_rng(seed)
    time = np.arange(900) / 300
    torque = multisine(time, 25.0, (0.5, 1.3, 2.1, 3.7), seed=5)
    motion = simulate(RIGID, time, {"torque": torque + 0.05 * rng.standard_normal(900)}, RIGID_TRUTH)
    measured = Sensors(noise={"link_position": 1e-5}).measure(motion, seed, keep=("link_position",))
    return measured.with_channels({"torque": torque})


def starts(seed: int) -> dict[str, float]:
    """Each parameter off by up to a factor of three, up or down."""
    off = np.exp(np.log(3.0) * np.random.default_rng(100 + seed).uniform(-1, 1, len(FREE)))
    return {name: HARMONIC.parameter(name).nominal * k for name, k in zip(FREE, off, strict=True)}


def errors(estimate, truth) -> dict[str, float]:
    """Errors over their standard deviation."""
    return {n: (estimate[n].value - truth[n]) / estimate[n].std_dev for n in estimate.free}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_nine_parameters_from_starts_off_by_three(seed):
    estimate = fit(HARMONIC, closed_loop(seed), ParameterSettings(starts(seed)))
    assert estimate.status is Status.CONVERGED, estimate.message
    assert estimate.free == FREE
    truth = HARMONIC.values()
    for name, z in errors(estimate, truth).items():
        assert abs(z) < 4.0, (name, z)
        assert estimate[name].verdict is Verdict.ESTIMATED
        assert estimate[name].std_dev < 0.05 * truth[name], name
    assert estimate["J_m"].std_dev < 0.01 * truth["J_m"]
    assert estimate["k_1"].std_dev < 0.01 * truth["k_1"]
    assert estimate.chi2 == pytest.approx(1.0, abs=0.1)
    for name, sigma in {**SENSORS.noise, "input torque": TORQUE_NOISE}.items():
        assert estimate.noise[name] == pytest.approx(sigma, rel=0.3), name
    assert all(abs(w) < 0.2 for w in estimate.whiteness.values())
    assert all(v < 0.1 for v in estimate.nrmse.values())


def test_standard_deviations_are_honest():
    """Errors of nine parameters in eight draws: their mean square in standard deviations is near one."""
    truth = HARMONIC.values()
    z = np.array([list(errors(fit(HARMONIC, closed_loop(s)), truth).values()) for s in range(1, 9)])
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.4
    assert np.mean(np.abs(z) < 1.96) > 0.85


@pytest.mark.parametrize("seed", [1, 2])
def test_link_position_and_motor_velocity_are_enough(seed):
    recording = closed_loop(seed)
    partial = Recording(recording.time, {n: recording[n] for n in PARTIAL})
    estimate = fit(HARMONIC, partial, ParameterSettings(starts(seed)))
    assert estimate.status is Status.CONVERGED, estimate.message
    assert set(estimate.nrmse) == {"link_position", "motor_velocity"}
    for name, z in errors(estimate, HARMONIC.values()).items():
        assert abs(z) < 4.0, (name, z)


def test_windows_that_begin_under_load_are_followed_from_their_first_sample():
    """The motor angle is not measured: the twist at the start comes from the drive."""
    whole = closed_loop(1)
    partial = Recording(whole.time, {n: whole[n] for n in PARTIAL})
    known = fit(HARMONIC, partial)
    for begin in (0.4, 0.6, 0.8):
        estimate = fit_innovations(HARMONIC, partial.window(begin, begin + 1.2), previous=known)
        assert estimate.status is Status.CONVERGED, (begin, estimate.message)
        assert estimate.iterations < 20
        assert all(abs(z) < 4.5 for z in errors(estimate, HARMONIC.values()).values()), begin


def test_missing_labels_and_gaps_cost_precision_and_nothing_else():
    """A third of the labels NaN, one by one, and a lost stretch: same truth within larger intervals."""
    whole = closed_loop(1)
    rng = np.random.default_rng(0)
    holes = {n: np.where(rng.random(1000) < 0.35, np.nan, whole[n]) for n in HARMONIC.state_names}
    keep = np.r_[0:400, 410:800, 803:1000]
    thin = whole.with_channels(holes)
    thin = Recording(thin.time[keep], {n: v[keep] for n, v in thin.channels.items()})
    full, estimate = fit(HARMONIC, whole), fit(HARMONIC, thin)
    assert estimate.status is Status.CONVERGED, estimate.message
    for name, z in errors(estimate, HARMONIC.values()).items():
        assert abs(z) < 4.0, (name, z)
        assert estimate[name].std_dev > full[name].std_dev, name


@pytest.mark.parametrize("seconds", [0.02, 0.3])
def test_a_cut_in_the_record_with_the_labels_of_a_robot_does_no_harm(seconds):
    """A connection that was lost for a while, in the middle of a window."""
    whole = closed_loop(1)
    keep = (whole.time < 1.0) | (whole.time > 1.0 + seconds)
    sent = ("link_position", "motor_velocity", "torque")
    cut = Recording(whole.time[keep], {n: whole[n][keep] for n in sent})
    estimate = fit(HARMONIC, cut)
    assert estimate.status is Status.CONVERGED, estimate.message
    for name, z in errors(estimate, HARMONIC.values()).items():
        assert abs(z) < 4.0, (name, z)


def test_samples_without_an_input_are_left_out_and_counted():
    recording = rigid()
    torque = recording["torque"].copy()
    torque[200:204] = np.nan
    estimate = fit(RIGID, recording.with_channels({"torque": torque}))
    assert estimate.status is Status.CONVERGED
    assert "4 samples without an input were left out." in estimate.notes
    assert estimate.samples == len(recording) - 4
    assert all(abs(z) < 4.0 for z in errors(estimate, RIGID_TRUTH).values())


def test_fixed_and_freed_parameters():
    held = fit(RIGID, rigid(), ParameterSettings({"tau_f": 2.0}, fixed=("tau_f",)))
    assert held.free == ("J", "c", "tau_0")
    assert (held["tau_f"].value, held["tau_f"].verdict) == (2.0, Verdict.FIXED)
    assert np.isnan(held["tau_f"].std_dev)
    assert held.covariance.shape == (3, 3)
    assert held["c"].std_dev < fit(RIGID, rigid())["c"].std_dev
    freed = fit(RIGID, rigid(), ParameterSettings({"J": 1.7, "N": 0.7}, fixed=("J",), freed=("N",)))
    assert "N" in freed.free
    assert abs(freed["N"].value - 1.0) < 4.0 * freed["N"].std_dev < 0.1


def test_a_positive_parameter_stays_positive():
    """Without friction its level goes towards zero, never below."""
    time = np.arange(900) / 300
    torque = multisine(time, 25.0, (0.5, 1.3, 2.1), seed=5)
    truth = {"J": 1.7, "c": 3.0, "tau_f": 0.0, "tau_0": 0.0}
    motion = simulate(RIGID, time, {"torque": torque + 0.05 * np.random.default_rng(1).standard_normal(900)}, truth)
    motion = Sensors(noise={"link_position": 1e-5}).measure(motion, 1, keep=("link_position",))
    estimate = fit(RIGID, motion.with_channels({"torque": torque}))
    assert 0.0 < estimate["tau_f"].value < 0.1


def test_an_estimate_stops_at_its_bound_and_says_so(monkeypatch):
    """A table that allows J only up to 1.5, where the data say 1.7."""
    measured, rows = rigid(), tuple(replace(p, upper=1.5) if p.name == "J" else p for p in RIGID.parameters)
    monkeypatch.setattr(type(RIGID), "parameters", property(lambda self: rows))
    estimate = fit(RIGID, measured)
    assert estimate["J"].value == pytest.approx(1.5, rel=1e-12)
    assert estimate["J"].verdict is Verdict.AT_BOUND
    assert estimate["c"].verdict is Verdict.ESTIMATED


def test_what_the_motion_does_not_show_is_named():
    """One way at a steady speed: friction and damping cannot be told apart, inertia hardly shows."""
    time = np.arange(1000) / 500
    torque = np.full(1000, 5.0) + 0.01 * np.sin(3.0 * time)
    truth = {"J": 1.0, "c": 3.0, "tau_f": 2.0, "tau_0": 0.0}
    motion = simulate(RIGID, time, {"torque": torque}, truth, x0={"link_velocity": 1.0})
    measured = Sensors(noise={"link_position": 1e-4}).measure(motion, 0, keep=("link_position", "torque"))
    estimate = fit(RIGID, measured)
    unseen = {p.name for p in estimate.parameters if p.verdict in (Verdict.NOT_EXCITED, Verdict.PRIOR)}
    assert {"tau_f", "tau_0"} & unseen
    for name in unseen:
        assert name in next(note for note in estimate.notes if "does not show" in note)
    for name in unseen:
        row, value = RIGID.parameter(name), estimate[name].value
        known = min(0.5 * row.spread, MAGNITUDE) * value if row.positive else 0.5 * row.spread
        assert estimate[name].std_dev > known
    bounds = re.search("it lies (?:between (.*) and|below about) (.*) Nm", estimate["c"].reason).groups()
    assert float(bounds[0] or 0.0) < truth["c"] < float(bounds[1])


def test_a_drive_that_does_not_cause_the_motion_is_a_poor_fit():
    """A torque of another joint fits no inertia, however much noise it is granted."""
    motion = closed_loop(1)
    other = np.random.default_rng(3).standard_normal(1000)
    estimate = fit(
        RIGID,
        Recording(motion.time, {"link_position": motion["link_position"], "torque": other}),
        ParameterSettings({"N": 101.0}),
    )
    assert estimate.status is Status.POOR_FIT
    assert "does not cause this motion" in estimate.message
    assert "do not trust the standard deviations" in estimate.message


def test_a_small_load_is_no_reason_for_a_poor_fit():
    """Noise of the torque that is larger than it, but much smaller than the torque itself."""
    motion = rigid()
    load = motion.with_channels({"external_torque": 1e-4 * np.sin(motion.time)})
    estimate = fit(RIGID, load)
    assert estimate.converged and not any("does not cause" in note for note in estimate.notes)


@pytest.mark.parametrize(
    ("change", "status", "says"),
    [
        (lambda r: r.slice(0, 20), Status.TOO_SHORT, "20 samples"),
        (lambda r: r.slice(0, 0), Status.TOO_SHORT, "0 samples"),
        (lambda r: r.with_channels({"link_position": np.full(900, 0.3)}), Status.NO_MOTION, "did not change"),
        (lambda r: Recording(r.time, {"torque": r["torque"]}), Status.MISSING_SIGNAL, "measures none of the states"),
        (
            lambda r: Recording(r.time, {"link_position": r["link_position"]}),
            Status.MISSING_SIGNAL, "has no torque, an input of model rigid_joint",
        ),
        (lambda r: r.with_channels({"torque": np.full(900, np.nan)}), Status.MISSING_SIGNAL, "has no torque"),
        (
            lambda r: r.with_channels({"torque": np.where(np.arange(900) < 870, np.nan, r["torque"])}),
            Status.TOO_SHORT, "only 30 samples have all inputs (torque, external_torque)",
        ),
        (
            lambda r: r.with_channels({"link_position": np.full(900, np.nan)}),
            Status.MISSING_SIGNAL, "measures none of the states",
        ),
    ],
)  # fmt: skip
def test_data_that_cannot_be_fitted_are_a_status(change, status, says):
    estimate = fit(RIGID, change(rigid()))
    assert estimate.status is status
    assert says in estimate.message
    assert "\n" not in estimate.message
    assert all(np.isnan(p.std_dev) for p in estimate.parameters)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"values": {"k_9": 1.0}}, "model rigid_joint has no parameter 'k_9'"),
        ({"values": {"J": -1.0}}, r"parameter J = -1 kg m\^2 is outside its bounds"),
        ({"values": {"J": float("nan")}}, "parameter J = nan: must be a finite number"),
        ({"fixed": ("k_9",)}, "no parameter 'k_9'"),
        ({"freed": ("k_9",)}, "no parameter 'k_9'"),
        ({"values": {"tau_f": 0.0}}, "parameter tau_f starts at 0.*--fix tau_f=0"),
        ({"fixed": ("J", "c", "tau_f", "tau_0")}, "every parameter is fixed"),
        ({"fixed": "J"}, r"fixed = 'J': give a list of names"),
    ],
)
def test_misuse_is_an_error_of_one_line(arguments, says):
    with pytest.raises(JointIdError, match=says) as error:
        fit(RIGID, rigid(), ParameterSettings(**arguments))
    assert "\n" not in str(error.value)


def test_the_same_data_give_the_same_bits():
    a, b = (fit(RIGID, rigid(), ParameterSettings({"J": 0.8})) for _ in range(2))
    assert a.values == b.values
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert a.noise == b.noise


@settings(max_examples=6, deadline=None)
@given(shift=st.floats(-1e3, 1e6), turn=st.floats(-50.0, 50.0))
def test_neither_the_clock_nor_the_zero_of_the_encoder_matters(shift, turn):
    """Without gravity nothing depends on where time and angle begin."""
    r = rigid()
    moved = Recording(r.time + shift, {"link_position": r["link_position"] + turn, "torque": r["torque"]})
    a, b = fit(RIGID, r), fit(RIGID, moved)
    for name in a.free:
        assert abs(a[name].value - b[name].value) < 0.05 * a[name].std_dev, name
        assert b[name].std_dev == pytest.approx(a[name].std_dev, rel=0.02)


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2))
def test_the_mirrored_motion_gives_the_same_joint(seed):
    """All signals with their sign turned: the same parameters, the offset turned."""
    r = rigid(seed)
    mirrored = Recording(r.time, {n: -v for n, v in r.channels.items()})
    a, b = fit(RIGID, r), fit(RIGID, mirrored)
    for name in a.free:
        sign = -1.0 if name == "tau_0" else 1.0
        assert abs(a[name].value - sign * b[name].value) < 0.01 * a[name].std_dev, name
