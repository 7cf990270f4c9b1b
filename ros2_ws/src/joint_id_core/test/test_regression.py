"""Inverse-dynamics regression: values, honest intervals for residuals with a memory, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, Regression, build, fit
from joint_id_core.estimators.regression.covariance import automatic_lag, newey_west
from joint_id_core.estimators.regression.equations import Motion, equations
from joint_id_core.estimators.regression.least_squares import explained_later, solve
from joint_id_core.models import build as build_model
from joint_id_core.results.estimate import Status, Verdict
from joint_id_core.simulation.motion import simulate_motion
from joint_id_core.simulation.simulator import simulate

from .online_motion import MODEL, TRUTH, motion
from .quick import first_quick

COUNT = 2000


def remembering(rng: np.random.Generator, count: int, memory: float) -> np.ndarray:
    """Unit noise with a memory, in samples (Ornstein-Uhlenbeck)."""
    kept = np.exp(-1.0 / memory)
    values, noise = np.zeros(count), np.sqrt(1.0 - kept**2) * rng.standard_normal(count)
    for k in range(1, count):
        values[k] = kept * values[k - 1] + noise[k]
    return values


def columns() -> np.ndarray:
    """Acceleration, velocity and direction of a slow motion."""
    t = np.arange(COUNT) / 50.0
    w = np.sin(0.7 * t) + 0.4 * np.sin(1.9 * t + 1.0)
    return np.column_stack([np.gradient(w, t), w, np.tanh(50.0 * w)])


def shares(memory: float, lag: float) -> np.ndarray:
    """Share of the 95 % intervals that hold the truth, by parameter."""
    table, pieces, held = columns(), np.zeros(COUNT, dtype=np.int64), []
    for seed in range(200):
        y = table @ [2.0, 3.0, 5.0] + remembering(np.random.default_rng(seed), COUNT, memory)
        found = solve(y, table, [True] * 3, pieces, lag)
        held.append(np.abs(found.values - [2.0, 3.0, 5.0]) < 1.96 * np.sqrt(np.diag(found.covariance)))
    return np.mean(held, axis=0)


@pytest.mark.parametrize("memory", first_quick([40.0, 0.1, 10.0]))
def test_intervals_hold_the_truth_whatever_the_memory_of_the_disturbance(memory):
    assert shares(memory, 0.0).min() > 0.88
    assert shares(memory, 0.0).mean() < 0.995


def test_without_the_memory_intervals_would_be_too_small():
    assert shares(20.0, 1.0).mean() < 0.6


def test_the_automatic_lag_grows_with_the_memory():
    rng = np.random.default_rng(0)
    lags = [automatic_lag(remembering(rng, COUNT, memory)[:, None]) for memory in (0.1, 5.0, 20.0)]
    assert 1.0 <= lags[0] < 5.0 < lags[1] < lags[2]


def test_stretches_are_independent():
    """With a stretch a sample, whatever the lag, the covariance is that of White (Econometrica 48, 1980)."""
    table, rng = columns(), np.random.default_rng(1)
    residuals = remembering(rng, COUNT, 10.0)
    apart, together = np.arange(COUNT), np.zeros(COUNT, dtype=np.int64)
    inverse = np.linalg.inv(table.T @ table)
    white = inverse @ (table * residuals[:, None] ** 2).T @ table @ inverse
    found = newey_west(table, residuals, apart, 20.0)
    assert np.allclose(found / found[0, 0], white / white[0, 0], rtol=1e-9)
    assert np.all(np.diag(newey_west(table, residuals, together, 20.0)) > 2.0 * np.diag(found))


def test_a_joint_is_found_with_honest_intervals():
    off = []
    for seed in range(8):
        found = fit(MODEL, motion(seed=seed), estimator=Regression())
        assert found.converged and found.estimator == "regression" and found.elapsed_s < 10.0
        assert {p.verdict for p in found.parameters if p.name in TRUTH} == {Verdict.ESTIMATED}
        off.append([(found[n].value - v) / found[n].std_dev for n, v in TRUTH.items()])
        assert all(abs(found[n].value - v) < 0.02 * abs(v) for n, v in TRUTH.items())
    assert np.abs(off).max() < 4.0 and np.sqrt(np.mean(np.square(off))) < 2.0


def test_an_input_that_is_held_between_samples_acts_half_a_period_late():
    """At 50 Hz half a period is 10 ms: taken for the value at the instant, c would be far off."""
    record = motion()
    slow = Recording(record.time[::5], {n: v[::5] for n, v in record.channels.items()})
    held = slow["torque"][np.arange(len(record)) // 5]
    moved = simulate(MODEL, record.time, {"torque": held}, TRUTH)
    seen = Recording(slow.time, {"link_position": moved["link_position"][::5], "torque": slow["torque"]})
    found = fit(MODEL, seen, estimator=Regression())
    late = seen.with_channels({"torque": np.append(slow["torque"][1:], slow["torque"][-1])})
    wrong = fit(MODEL, late, estimator=Regression())
    assert abs(found["c"].value - TRUTH["c"]) < 0.1 * TRUTH["c"] < 0.2 * abs(wrong["c"].value - TRUTH["c"])


def test_the_equations_are_those_of_the_model():
    """Known terms minus columns times parameters is zero for a motion that the model makes."""
    model = build_model("rigid_joint", actuation="current", gravity=True)
    values = model.values({"k_t": 0.1, "N": 101.0, "a_g": 3.0, "b_g": -2.0})
    rng = np.random.default_rng(0)
    q, w, i, load = rng.standard_normal((4, 50))
    torque = values["N"] * values["k_t"] * i - load - values["c"] * w - values["tau_f"] * np.tanh(w / values["w_s"])
    torque -= values["tau_0"] + 3.0 * np.cos(q) - 2.0 * np.sin(q)
    made = Motion(
        {"link_position": q, "link_velocity": w}, {"current": i, "external_torque": load},
        {"link_position": w, "link_velocity": torque / values["J"]},
    )  # fmt: skip
    free = ("J", "c", "tau_f", "tau_0", "a_g", "b_g")
    (found,) = equations(model, made, values, free)
    assert found.names == free and found.factor == pytest.approx(10.1)
    assert np.abs(found.y - found.columns @ [values[n] for n in free]).max() < 1e-9
    assert np.allclose(found.columns[:, 1], w) and np.allclose(found.columns[:, 4], np.cos(q))
    assert [n for n, static in zip(free, found.static, strict=True) if static] == ["tau_0", "a_g", "b_g"]


def test_parameters_in_which_the_equation_is_not_linear_are_held_and_named():
    model = build_model("rigid_joint", friction="stribeck")
    found = fit(model, motion(), estimator=Regression())
    assert found["w_b"].verdict is Verdict.FIXED and "w_b" not in found.free and "dtau_s" in found.free
    assert any("w_b" in note and "cannot tell" in note for note in found.notes)


def test_a_positive_parameter_does_not_get_below_zero():
    table, rng = columns(), np.random.default_rng(2)
    y = table @ [2.0, -3.0, 5.0] + 0.1 * rng.standard_normal(COUNT)
    found = solve(y, table, [True] * 3, np.zeros(COUNT, dtype=np.int64))
    assert found.held.tolist() == [False, True, False] and found.values[1] == 0.0
    assert np.isnan(found.covariance[1]).all() and found.covariance[0, 0] > 0.0


def test_what_follows_from_other_parameters_is_not_said_to_be_known():
    table = columns()
    table = np.column_stack([table, 2.0 * table[:, 1], np.zeros(COUNT)])
    found = solve(table @ [2.0, 3.0, 5.0, 0.0, 0.0], table, [False] * 5, np.zeros(COUNT, dtype=np.int64))
    assert found.unseen.tolist() == [False, False, False, True, True]
    assert found.values[:3] == pytest.approx([2.0, 3.0, 5.0])


def test_a_torque_that_does_not_cause_the_motion_is_a_poor_fit():
    record = motion()
    wrong = record.with_channels({"torque": np.random.default_rng(0).permutation(record["torque"])})
    found = fit(MODEL, wrong, estimator=Regression())
    assert found.status is Status.POOR_FIT and "explained" in found.message


def test_gravity_that_the_model_lacks_makes_a_poor_fit_and_a_right_one_with_it():
    """On a wrist of a UR10e, J without gravity was 8 times too large, with 95 % of the torque explained."""
    loaded = build_model("rigid_joint", gravity=True)
    time = motion().time
    torque = motion()["torque"]
    truth = {**TRUTH, "a_g": 5.0, "b_g": 40.0}
    moved = simulate(loaded, time, {"torque": torque}, truth)
    record = Recording(time, {"link_position": moved["link_position"], "torque": torque})
    poor = fit(MODEL, record, estimator=Regression())
    assert poor.status is Status.POOR_FIT and "--gravity" in poor.message
    right = fit(loaded, record, estimator=Regression())
    assert right.converged
    assert all(abs(right[n].value - v) < 3.0 * right[n].std_dev for n, v in truth.items())


def test_a_small_value_that_noise_makes_negative_is_not_known_and_no_fault():
    """Its interval holds zero; a value that the data pull below zero by more is a fault of the model."""
    table, rng = columns(), np.random.default_rng(4)
    y = table @ [0.0, 3.0, 5.0] + 0.1 * rng.standard_normal(COUNT)
    found = solve(y, table, [True] * 3, np.zeros(COUNT, dtype=np.int64))
    assert abs(found.unbounded[0]) < 3.0 * found.sigma[0] and not found.below.any()
    pulled = solve(y - 0.5 * table[:, 0], table, [True] * 3, np.zeros(COUNT, dtype=np.int64))
    assert pulled.below.tolist() == [True, False, False]
    assert pulled.unbounded[0] == pytest.approx(found.unbounded[0] - 0.5)


def test_what_the_first_part_explains_of_the_rest_is_judged_without_the_static_load():
    """A large load of gravity, which any fit describes, does not hide that the motion is not described."""
    table, static = columns(), np.array([False, False, False, True])
    rng = np.random.default_rng(5)
    gravity = 100.0 * np.cos(np.arange(COUNT) / 300.0)
    loaded, pieces = np.column_stack([table, gravity]), np.zeros(COUNT, dtype=np.int64)
    right = loaded @ [2.0, 3.0, 5.0, 1.0] + 0.05 * rng.standard_normal(COUNT)
    wrong = gravity + 3.0 * remembering(rng, COUNT, 100.0)
    shares = [explained_later(y, loaded, [True] * 3 + [False], static, pieces).at_best for y in (right, wrong)]
    assert shares[0] > 0.99 and shares[1] < 0.5
    assert explained_later(wrong, loaded, [True] * 3 + [False], np.zeros(4, dtype=bool), pieces).share > 0.9


def test_what_the_first_part_hardly_shows_is_no_fault_of_the_equation():
    """A load that hardly changes there may be anything in the rest; a load that is not in the equation is none."""
    table, rng = columns(), np.random.default_rng(6)
    late = np.where(np.arange(COUNT) < 0.7 * COUNT, 1e-3 * rng.standard_normal(COUNT), 1.0)
    loaded, pieces = np.column_stack([table, late]), np.zeros(COUNT, dtype=np.int64)
    right = loaded @ [2.0, 3.0, 5.0, 1.0] + 0.5 * rng.standard_normal(COUNT)
    known = [True] * 3 + [False]
    found = explained_later(right, loaded, known, np.zeros(4, dtype=bool), pieces)
    assert found.share < 0.9 < found.at_best
    other = explained_later(right + 30.0 * late, table, [True] * 3, np.zeros(3, dtype=bool), pieces)
    assert other.at_best < 0.9


@pytest.mark.parametrize("noise", [1e-5, 5e-4])
def test_noise_of_the_encoder_does_not_make_inertia_smaller(noise):
    """The band ends where noise of the acceleration would; a cruder encoder leaves less of it."""
    record = motion()
    rng = np.random.default_rng(6)
    seen = record.with_channels({"link_position": record["link_position"] + noise * rng.standard_normal(len(record))})
    found = fit(MODEL, seen, estimator=Regression())
    assert abs(found["J"].value - TRUTH["J"]) < 0.02 * TRUTH["J"]
    assert abs(found["c"].value - TRUTH["c"]) < 0.05 * TRUTH["c"]


def test_data_that_cannot_be_used_come_back_with_a_status():
    record = motion()
    assert fit(MODEL, record.slice(0, 30), estimator=Regression()).status is Status.TOO_SHORT
    assert fit(MODEL, record, estimator=Regression(band_hz=0.5)).status is Status.TOO_SHORT
    still = record.with_channels({"link_position": np.zeros(len(record))})
    assert fit(MODEL, still, estimator=Regression()).status is Status.NO_MOTION
    only = Recording(record.time, {"link_position": record["link_position"]})
    assert fit(MODEL, only, estimator=Regression()).status is Status.MISSING_SIGNAL


@pytest.mark.parametrize("name", ["harmonic_drive", "electromechanical"])
def test_models_that_it_does_not_suit_are_refused(name):
    with pytest.raises(JointIdError, match="regression does not suit"):
        fit(build_model(name), motion(), ParameterSettings(), build("regression"))


def test_priors_are_refused():
    with pytest.raises(JointIdError, match="takes no priors"):
        fit(MODEL, motion(), ParameterSettings(priors={"c": 0.1}), Regression())


def test_the_result_can_be_saved_and_shown(tmp_path):
    found = fit(MODEL, motion(), estimator=Regression())
    found.save(tmp_path / "found.json")
    assert type(found).load(tmp_path / "found.json") == found
    assert "rigid_joint by regression: converged" in str(found)


def test_a_motor_with_its_circuit_is_found():
    """Both equations, of the voltage and of the torque, with the inertia of the rotor known."""
    model = build_model("dc_motor")
    truth = model.values()
    found = fit(model, simulate_motion(model, 6.0, 1000.0, seed=3), estimator=Regression())
    assert found.converged
    for name in ("R", "k_b", "k_t", "c_b", "tau_fc"):
        assert found[name].verdict is Verdict.ESTIMATED
        assert abs(found[name].value - truth[name]) < min(3.0 * found[name].std_dev, 0.02 * truth[name])


def test_a_voltage_that_does_not_drive_the_current_is_named():
    model = build_model("dc_motor")
    record = simulate_motion(model, 6.0, 1000.0, seed=3)
    wrong = record.with_channels({"voltage": np.random.default_rng(0).permutation(record["voltage"])})
    found = fit(model, wrong, estimator=Regression())
    assert found.status is Status.POOR_FIT and "of the voltage" in found.message


def test_an_equation_without_any_column_that_is_shown_has_the_least_lag():
    assert automatic_lag(np.zeros((100, 0))) == 1.0


@pytest.mark.parametrize("name", ["torque", "link_position", "external_torque"])
@pytest.mark.parametrize("first", [0, 2000])
def test_samples_without_a_value_are_left_out(name, first):
    """One missing value once left no equation linear."""
    record = motion(10.0)
    channels = {**record.channels, "external_torque": np.zeros(len(record))}
    channels[name] = channels[name].copy()
    channels[name][first : first + 3] = np.nan
    found = fit(MODEL, Recording(record.time, channels), estimator=Regression())
    assert found.status is Status.CONVERGED, found.message
    for parameter, truth in TRUTH.items():
        assert abs(found[parameter].value - truth) < 4.0 * found[parameter].std_dev
