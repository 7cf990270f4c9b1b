"""The implicit cell: exact where RK4 blows up, with sensitivities that are its own derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from joint_id_core import estimators
from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout, rollout_sensitivities
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.models import build
from joint_id_core.results.estimate import Status
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate
from joint_id_core.validation import held_out

MOTOR = build("dc_motor")
JOINT = build("electromechanical")
TIME = np.arange(600) * 1e-3
STEPS = np.select([TIME < 0.2, TIME < 0.4], [12.0, -9.0], 6.0)
# A tenth of the inductance: the current follows the voltage within 0.1 ms, |lambda h| = 10 at 1 ms.
STIFF = {"L": 5e-5}


def record(model, samples=600):
    u = np.zeros((samples, 2))
    u[:, 0] = STEPS[:samples]
    return np.zeros(len(model.states)), TIME[:samples], u


def values(model, **changes):
    given = model.values(changes)
    return np.array([given[n] for n in model.parameter_names])


def test_a_stiff_linear_motor_follows_the_matrix_exponential_where_rk4_does_not():
    """Without friction the motor is linear; after each step of the voltage the fast mode dies out within a sample."""
    p = MOTOR.values({"tau_fc": 0.0, "L": 5e-6})
    big = np.zeros((3, 3))
    big[:2, :2] = [[-p["R"] / p["L"], -p["k_b"] / p["L"]], [p["k_t"] / p["J_r"], -p["c_b"] / p["J_r"]]]
    big[0, 2] = 1.0 / p["L"]
    whole = expm(big * 1e-3)
    exact = np.zeros((600, 2))
    for k in range(599):
        exact[k + 1] = whole[:2, :2] @ exact[k] + whole[:2, 2] * STEPS[k]
    x0, time, u = record(MOTOR)
    arguments = (x0, time, u, values(MOTOR, tau_fc=0.0, L=5e-6))
    found = rollout(compile_model(MOTOR, cell="implicit"), *arguments)
    settled = np.min(np.abs(time[:, None] - [0.0, 0.2, 0.4]), axis=1) > 0.004
    np.testing.assert_allclose(
        found[settled] / np.ptp(exact, axis=0), exact[settled] / np.ptp(exact, axis=0), atol=1e-4
    )
    with np.errstate(all="ignore"):
        assert not np.isfinite(rollout(compile_model(MOTOR), *arguments)).all()


def test_its_order_is_four():
    """Halving the step divides the error of a smooth run by about sixteen."""
    x0, time, _ = record(JOINT, 60)
    u = np.zeros((60, 2))
    u[:, 0] = 8.0
    p = values(JOINT, tau_fm=0.0)
    x0 = rollout(compile_model(JOINT), x0, time, u, p, 64)[-1]  # past the first transient
    exact = rollout(compile_model(JOINT), x0, time, u, p, 200)
    kernel = compile_model(JOINT, cell="implicit")
    coarse, fine = (np.abs(rollout(kernel, x0, time, u, p, s) - exact).max(axis=0) for s in (1, 2))
    assert np.all(coarse / fine > 10.0)


@pytest.mark.parametrize("substeps", [1, 3])
def test_sensitivities_are_those_of_the_discrete_run(substeps):
    x0, time, u = record(JOINT, 300)
    kernel = compile_model(JOINT, cell="implicit")
    # friction ten times smoother than usual, so that a finite difference sees a derivative and not a kink
    p = values(JOINT, **STIFF, w_sm=0.3)
    X, J = rollout_sensitivities(kernel, x0, time, u, p, substeps)
    np.testing.assert_allclose(X, rollout(kernel, x0, time, u, p, substeps), atol=1e-10 * np.abs(X).max())
    for j, name in enumerate(kernel.sensitive):
        i = JOINT.parameter_names.index(name)
        h = 1e-4 * p[i] * np.eye(len(p))[i]
        up, down = (rollout(kernel, x0, time, u, q, substeps) for q in (p + h, p - h))
        numeric = (up - down) / (2 * h[i])
        scale = np.abs(numeric).max(axis=0) + 1e-12 * np.ptp(X, axis=0) / h[i]
        np.testing.assert_allclose(J[:, :, j] / scale, numeric / scale, atol=2e-5, err_msg=name)


@pytest.fixture(scope="module")
def stiff_record():
    """Model 3 with a tenth of its inductance, all states measured at 1 kHz, made by the adaptive simulator."""
    motion = simulate(JOINT, TIME, {"voltage": STEPS}, STIFF)
    noise = {
        "current": 0.05, "motor_position": 1e-3, "link_position": 1e-5, "motor_velocity": 0.1, "link_velocity": 1e-3
    }  # fmt: skip
    return Sensors(noise=noise).measure(motion, 1)


def test_a_stiff_joint_is_fitted_at_one_step_a_sample_where_rk4_is_not(stiff_record):
    start = STIFF | {name: 1.5 * JOINT.parameter(name).nominal for name in ("R", "k_t", "k_b", "c_m")}
    estimate, explicit = (
        fit_innovations(JOINT, stiff_record, ParameterSettings(start), options=Innovations(cell=cell, substeps=1))
        for cell in ("implicit", "rk4")
    )
    assert estimate.status is Status.CONVERGED, estimate.message
    truth = JOINT.values(STIFF)
    for name in ("R", "k_b", "k_t", "c_m", "tau_fm", "c_1", "k_1", "c_q"):
        assert abs(estimate[name].value - truth[name]) < 4.0 * estimate[name].std_dev, name
    assert estimate["R"].value == pytest.approx(truth["R"], rel=0.01)
    assert not explicit.converged


def test_what_the_implicit_cell_cannot_do_is_refused(stiff_record):
    with pytest.raises(JointIdError, match="smoothed friction"):
        compile_model(MOTOR, "sign", cell="implicit")
    with pytest.raises(JointIdError, match="choose one of rk4, implicit"):
        compile_model(MOTOR, cell="euler")
    with pytest.raises(JointIdError, match="estimator hpinn has no option cell"):
        estimators.build("hpinn", cell="implicit")


def test_held_out_prediction_takes_the_cell_of_the_fit(stiff_record):
    """An RK4 kernel at the step count of the implicit cell runs away."""
    estimate = estimators.fit(JOINT, stiff_record, ParameterSettings(STIFF), Innovations(cell="implicit", substeps=1))
    assert (estimate.cell, estimate.substeps) == ("implicit", 1)
    assert max(held_out(JOINT, stiff_record, estimate).values()) < 0.1
    explicit = held_out(JOINT, stiff_record, replace(estimate, cell="rk4"))
    assert not max(explicit.values()) < 1.0
