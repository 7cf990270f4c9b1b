"""Friction that turns fast: a few samples with many steps, against an adaptive integrator."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout
from joint_id_core.data.recording import Recording
from joint_id_core.estimators import Innovations, fit
from joint_id_core.estimators.innovations import checks
from joint_id_core.estimators.innovations import fit as fitting
from joint_id_core.estimators.innovations import misfit as tests_of_residuals
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.substeps import MOST_STEPS, MOST_TURNING, steps_of
from joint_id_core.models import build
from joint_id_core.simulation import simulate_motion

MOTOR, PERIOD = build("dc_motor"), 0.002


def reversal() -> Recording:
    """A motor whose voltage changes its sign every 0.1 s: it turns within one sample, at 17,000 rad/s^2."""
    p = MOTOR.values()
    time = PERIOD * np.arange(301)
    voltage = np.where((time / 0.1).astype(int) % 2 == 0, 12.0, -12.0)

    def slope(_: float, x: np.ndarray, u: float) -> list[float]:
        friction = p["c_b"] * x[1] + p["tau_fc"] * math.tanh(x[1] / p["w_sm"])
        return [(u - p["R"] * x[0] - p["k_b"] * x[1]) / p["L"], (p["k_t"] * x[0] - friction) / p["J_r"]]

    states = [np.zeros(2)]
    for u in voltage[:-1]:
        run = solve_ivp(slope, (0.0, PERIOD), states[-1], "DOP853", args=(u,), rtol=1e-11, atol=1e-12, max_step=1e-5)
        states.append(run.y[:, -1])
    current, velocity = np.array(states).T
    return Recording(time, {"voltage": voltage, "current": current, "motor_velocity": velocity})


@pytest.mark.long
def test_a_velocity_that_turns_within_a_sample_is_simulated_as_an_adaptive_integrator_does():
    recording = reversal()
    data, kernel = prepare(MOTOR, recording), compile_model(MOTOR)
    at = [MOTOR.state_names.index(name) for name in ("current", "motor_velocity")]
    truth = np.empty((len(recording), 2))
    truth[:, at] = np.column_stack([recording["current"], recording["motor_velocity"]])
    steps = steps_of(data, kernel, data.p, truth, 12)
    assert np.mean(steps) < 32  # few samples take many
    assert MOST_STEPS < steps.max() <= MOST_TURNING

    def error(steps):
        return np.abs(rollout(kernel, truth[0], recording.time, data.u, data.p, steps) - truth)[:, at[1]].max()

    assert error(steps) < 2e-4  # rad/s, of 33
    assert error(64) > 10.0 * error(steps)  # of twice as many steps, evenly


def test_model_3_under_steps_of_voltage_needs_few_steps():
    model = build("electromechanical")
    estimate = fit(model, simulate_motion(model, duration=2.0))
    assert estimate.converged and estimate.substeps <= 12
    assert "too few" not in " ".join(estimate.notes)
    truth = model.values()
    z = [(estimate[name].value - truth[name]) / estimate[name].std_dev for name in estimate.free]
    assert np.abs(z).max() < 4.0


def test_what_the_residuals_show_belongs_to_the_pass_and_not_to_the_step_after_it(monkeypatch):
    """With another scale of the parameters, what they explain of a shape would come out as more than all of it."""
    model, found = build("electromechanical"), []
    run = fitting.run_checks
    monkeypatch.setattr(fitting, "run_checks", lambda outcome: found.append(outcome) or run(outcome))
    fit(model, simulate_motion(model, duration=2.0))
    outcome = found[0]
    recursion, minimum = outcome.stages.recursion, outcome.minimum
    last = recursion.renewed(minimum.last)

    def shares(z):
        seen = []
        possible = tests_of_residuals._Test.possible
        with monkeypatch.context() as patch:
            patch.setattr(tests_of_residuals._Test, "possible", lambda test: seen.append(test) or possible(test))
            tests_of_residuals.misfit(recursion, outcome.stages.coordinates, replace(minimum, z=z), last)
        return np.diag(seen[0].M) / seen[0].total

    here = shares(minimum.z)
    assert here.min() > -1e-6
    np.testing.assert_allclose(shares(minimum.z + 1e-3), here, atol=1e-6)


@pytest.mark.parametrize(("mode", "named"), [(900.0, False), (50_000.0, True)])
def test_the_implicit_cell_is_named_for_stiff_joints_alone(monkeypatch, mode, named):
    """900/s are slow for 48 steps in 2 ms: that cell would need as many."""
    monkeypatch.setattr(checks, "fastest_mode", lambda *_, **__: mode)
    data = SimpleNamespace(free=("k_1",), period=0.002)
    cost = SimpleNamespace(values=lambda z: z)
    stages = SimpleNamespace(
        data=data, cost=cost, kernel=None, rough_states=None, options=Innovations(), least=np.zeros(1)
    )
    found = SimpleNamespace(z=np.ones(1), substeps=48, integration=np.ones(1), inverse=np.eye(1))
    text = checks._step_warning(stages, found)
    assert text.startswith("48 steps a sample are too few") and ("--cell implicit" in text) is named
