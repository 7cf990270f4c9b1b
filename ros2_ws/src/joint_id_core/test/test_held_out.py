"""Prediction with known parameters: ahead of the data, and of the drive that a motion needs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.free_run import free_runs, nrmse
from joint_id_core.models import build
from joint_id_core.models.operations import ArrayOps
from joint_id_core.simulation.excitation import multisine
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate
from joint_id_core.validation import prediction as validation
from joint_id_core.validation.inverse_dynamics import drive, drive_errors, drive_r_squared
from joint_id_core.validation.prediction import held_out, held_out_drive, held_out_errors

RIGID = build("rigid_joint")
TRUTH = {"J": 1.7, "c": 3.0, "tau_f": 2.0, "tau_0": -0.6}
TIME = np.arange(1200) / 400


def measured(seed: int, J: float = 1.7) -> Recording:
    torque = multisine(TIME, 25.0, (0.5, 1.3, 2.1, 3.7), seed=seed)
    noise = 0.05 * np.random.default_rng(seed).standard_normal(len(TIME))
    motion = simulate(RIGID, TIME, {"torque": torque + noise}, TRUTH | {"J": J})
    seen = Sensors(noise={"link_position": 1e-5}).measure(motion, seed, keep=("link_position",))
    return seen.with_channels({"torque": torque})


def test_free_runs_restart_from_the_filtered_state_after_each_horizon():
    model, kernel = RIGID, compile_model(RIGID)
    data = prepare(model, measured(1), ParameterSettings(TRUTH))
    rng = np.random.default_rng(0)
    states = rng.standard_normal((len(TIME), 2))
    found = free_runs(kernel, data, states, data.p, 2, 0.05)["link_position"]
    for start in (0, 20, 1180):
        end = min(start + 20, 1199)
        part = slice(start, end + 1)
        run = rollout(kernel, states[start], data.time[part], data.u[part], data.p, 2)[:, 0]
        np.testing.assert_array_equal(found[start + 1 : end + 1], run[1:])
    assert found[0] == states[0, 0]


def test_nrmse_is_one_for_the_mean_and_skips_missing_labels():
    data = prepare(RIGID, measured(1))
    mean = np.full(len(data.time), data.y[:, 0].mean())
    assert nrmse(data, {"link_position": mean})["link_position"] == pytest.approx(1.0)
    y = data.y.copy()
    y[10:40, 0] = np.nan
    known = np.where(np.isnan(y[:, 0]), 1e9, y[:, 0])
    assert nrmse(replace(data, y=y), {"link_position": known})["link_position"] == 0.0


@pytest.mark.parametrize("name", ["rigid_joint", "harmonic_drive", "motor_side"])
def test_drive_is_the_inverse_of_the_model(name):
    """Exact accelerations put in, the drive that made them comes out."""
    model = build(name)
    rng = np.random.default_rng(2)
    x, u = rng.standard_normal((len(model.states), 50)), rng.standard_normal((len(model.inputs), 50))
    values = model.values()
    slopes = model.derivative(list(x), list(u), SimpleNamespace(**values), ArrayOps())
    driven = "motor" if "motor_velocity" in model.state_names else "link"
    channels = dict(zip(model.state_names, x, strict=True)) | dict(zip(model.input_names, u, strict=True))
    channels[f"{driven}_acceleration"] = slopes[model.state_names.index(f"{driven}_velocity")]
    predicted = drive(model, values, Recording(np.arange(50) * 0.01, channels))
    np.testing.assert_allclose(predicted, u[0], rtol=1e-6, atol=1e-6)


def test_a_voltage_or_an_unknown_motion_has_no_drive():
    motor = build("dc_motor")
    channels = {n: np.ones(50) for n in (*motor.state_names, "voltage")}
    assert drive(motor, motor.values(), Recording(np.arange(50) * 0.01, channels)) is None
    assert drive(build("harmonic_drive"), build("harmonic_drive").values(), measured(1)) is None


def test_a_slow_record_has_a_drive_too():
    """At 50 Hz the usual band does not fit below half the sampling rate."""
    time = np.arange(500) / 50
    q = 0.5 * np.sin(2 * time)
    torque = 1.7 * -4 * q + 3.0 * np.cos(2 * time) + 2.0 * np.sign(np.cos(2 * time)) - 0.6
    record = Recording(time, {"link_position": q, "torque": torque})
    predicted = drive(RIGID, RIGID.values(TRUTH), record)
    assert drive_r_squared(time, torque, predicted) > 0.99


def test_r_squared_of_the_drive_is_judged_in_the_band():
    """Noise far above the band does not count, an error within it does."""
    slow, fast = np.sin(2 * np.pi * TIME), 0.5 * np.sin(2 * np.pi * 80 * TIME)
    assert drive_r_squared(TIME, slow, slow + fast) > 0.999
    assert drive_r_squared(TIME, slow, 0.9 * slow) == pytest.approx(0.99, abs=0.002)
    assert drive_r_squared(TIME, slow, 0 * slow) == pytest.approx(0.0, abs=0.01)
    gaps = np.where(np.arange(len(TIME)) % 50 == 7, np.nan, slow)
    assert drive_r_squared(TIME, slow, gaps) > 0.999


def test_held_out_prediction_tells_a_good_model_from_a_bad_one():
    estimate = fit(RIGID, measured(1))
    good, other = measured(2), measured(2, J=5.0)
    assert held_out(RIGID, good, estimate)["link_position"] < 0.01
    assert held_out(RIGID, other, estimate)["link_position"] > 3 * held_out(RIGID, good, estimate)["link_position"]
    name, r_squared = held_out_drive(RIGID, good, estimate)
    assert name == "torque"
    assert r_squared > 0.995
    assert held_out_drive(RIGID, other, estimate)[1] < 0.9


def test_held_out_errors_leave_out_where_the_filter_does_not_know_the_state():
    """After the start and after a cut connection; nothing else, and no error there is large."""
    estimate = fit(RIGID, measured(1))
    recording = measured(2)
    keep = np.r_[0:500, 700:1200]  # 0.5 s cut out
    cut = Recording(recording.time[keep], {n: v[keep] for n, v in recording.channels.items()})
    errors = held_out_errors(RIGID, cut, estimate)["link_position"]
    seen = np.isfinite(errors)
    assert not seen[:41].any() and seen[41:500].all()  # 0.1 s at 400 Hz
    assert not seen[500:540].any() and seen[580:].all()
    assert np.nanmax(np.abs(errors)) < 0.003
    assert held_out(RIGID, cut, estimate)["link_position"] == pytest.approx(float(np.sqrt(np.nanmean(errors**2))))


def test_a_record_that_is_shorter_than_two_horizons_cannot_validate():
    estimate = fit(RIGID, measured(1))
    with pytest.raises(JointIdError, match="too short to validate on"):
        held_out(RIGID, measured(2).slice(0, 50), estimate, horizon_s=0.2)


def test_the_drive_is_not_judged_at_the_ends_and_around_gaps():
    slow = np.sin(2 * np.pi * TIME)
    time = np.where(TIME > 1.5, TIME + 1.0, TIME)
    errors = drive_errors(time, slow, 0.9 * slow)
    seen = np.isfinite(errors)
    middle = (np.abs(time - 1.5) < 0.19) | (np.abs(time - 2.5) < 0.19) | (time < 0.19) | (time > time[-1] - 0.19)
    assert not seen[middle].any()
    assert seen[(time > 0.21) & (time < 1.29)].all()
    assert np.isnan(drive_errors(TIME[:60], slow[:60], slow[:60])).all()
    assert np.isnan(drive_r_squared(TIME[:60], slow[:60], slow[:60]))


def test_a_prediction_that_runs_away_is_no_missing_one(monkeypatch):
    """Left out of the mean, it would flatter the model."""
    estimate = fit(RIGID, measured(1))

    def runs_away(*arguments):
        found = free_runs(*arguments)
        found["link_position"][500:510] = np.nan
        return found

    monkeypatch.setattr(validation, "free_runs", runs_away)
    errors = held_out_errors(RIGID, measured(2), estimate)["link_position"]
    assert np.flatnonzero(np.isinf(errors)).tolist() == list(range(500, 510))
    assert held_out(RIGID, measured(2), estimate)["link_position"] == np.inf
