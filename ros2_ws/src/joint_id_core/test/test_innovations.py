"""The innovations estimator finds the truth, with honest standard deviations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.data.recording import Recording
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.results.estimate import Status, Verdict

from .innovation_records import HARMONIC, RIGID, SENSORS, TORQUE_NOISE, closed_loop, errors, rigid

FREE = tuple(p.name for p in HARMONIC.parameters if not p.fixed)
PARTIAL = ("link_position", "motor_velocity", "torque")


def starts(seed: int) -> dict[str, float]:
    """Each parameter off by up to a factor of three, up or down."""
    off = np.exp(np.log(3.0) * np.random.default_rng(100 + seed).uniform(-1, 1, len(FREE)))
    return {name: HARMONIC.parameter(name).nominal * k for name, k in zip(FREE, off, strict=True)}


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
        # How noise is divided between drive and load, which a rigid joint does not show, depends on the last bits.
        assert b[name].std_dev == pytest.approx(a[name].std_dev, rel=0.05)


@pytest.mark.long
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
