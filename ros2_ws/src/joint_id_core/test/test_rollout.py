"""The compiled RK4 cell against closed forms, finer steps and finite differences."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout, rollout_sensitivities
from joint_id_core.errors import JointIdError
from joint_id_core.models import MODELS, build
from joint_id_core.models.operations import SmoothOps

from .linear_systems import exact_linear


def uneven_record(model, samples=60, seed=1):
    """Random start, steps between 0.2 and 0.6 ms with one gap, random inputs of a tenth of their scale."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(2e-4, 6e-4, samples - 1)
    steps[samples // 2] *= 3
    time = np.concatenate([[0.3], 0.3 + np.cumsum(steps)])
    x0 = 0.01 * rng.standard_normal(len(model.states)) * [s.scale for s in model.states]
    if "motor_position" in model.state_names and "link_position" in model.state_names:
        # 2 mrad of twist: enough for the cubic spring to show, where a random start would break a real drive
        names = model.state_names
        x0[names.index("motor_position")] = 101.0 * (x0[names.index("link_position")] + 2e-3)
    u = 0.1 * rng.standard_normal((samples, len(model.inputs))) * [s.scale for s in model.inputs]
    if "link_position" in model.input_names:  # the same for a measured link
        twist = 2e-3 * rng.standard_normal(samples)
        u[:, model.input_names.index("link_position")] = x0[model.state_names.index("motor_position")] / 101.0 + twist
    return x0, time, u


def values_of(model, **changes):
    return np.array(list(model.values(changes).values()))


def test_motor_without_friction_has_order_four():
    """Halving the step divides the error by 16, against the matrix exponential with unequal steps."""
    model = build("dc_motor")
    p = model.values({"tau_fc": 0.0})
    x0, time, u = uneven_record(model)
    A = np.array([[-p["R"] / p["L"], -p["k_b"] / p["L"]], [p["k_t"] / p["J_r"], -p["c_b"] / p["J_r"]]])
    exact = exact_linear(A, np.diag([1 / p["L"], -1 / p["J_r"]]), x0, time, u, [False, False], [None, None])
    kernel = compile_model(model)
    errors = []
    for substeps in (4, 8, 16, 32):
        X = rollout(kernel, x0, time, u, np.array(list(p.values())), substeps)
        errors.append(np.max(np.abs(X - exact) / np.ptp(exact, axis=0)))
    orders = -np.diff(np.log2(errors))
    np.testing.assert_allclose(orders, 4.0, atol=0.2)
    assert errors[-1] < 1e-7


def test_measured_inputs_run_on_and_commands_are_held():
    """Motor half of Model 2: torque is held, link velocity runs straight, link position along a parabola."""
    model = build("motor_side")
    p = model.values({"tau_fm": 0.0, "k_2": 0.0, "tau_0": 0.02, "dtheta_0": 1e-4})
    x0, time, u = uneven_record(model)
    N, J = p["N"], p["J_m"]
    A = np.array([[0, 1], [-p["k_1"] / (N * N * J), -(p["c_m"] + p["c_1"] / N**2) / J]])
    drive = np.array([[0, 0, 0], [1 / J, p["k_1"] / (N * J), p["c_1"] / (N * J)]])
    offset = np.array([[0.0], [(p["k_1"] * p["dtheta_0"] / N - p["tau_0"]) / J]])
    exact = exact_linear(
        A, np.hstack([drive, offset]), x0, time, np.hstack([u, np.ones((len(u), 1))]), [False, True, True, False],
        [None, 2, None, None],
    )  # fmt: skip
    X = rollout(compile_model(model), x0, time, u, np.array(list(p.values())), 10)
    np.testing.assert_allclose(X, exact, atol=1e-9 * np.abs(exact).max())


def test_a_link_that_moves_smoothly_is_followed_between_its_samples():
    """Motor half of Model 2 at 500 Hz, against scipy with the true link motion; a straight line is ten times worse."""
    model, omega = build("motor_side"), 2.0 * np.pi * 3.0
    p = model.values({"tau_fm": 0.0, "tau_0": 0.0})
    time = np.arange(200) / 500.0

    def link(t):
        return 0.3 * np.sin(omega * t), 0.3 * omega * np.cos(omega * t)

    def slope(t, x):
        return model.derivative(x, (0.0, *link(t)), SimpleNamespace(**p), SmoothOps())

    x0 = np.array([0.0, p["N"] * link(0.0)[1]])
    exact = solve_ivp(slope, (0.0, time[-1]), x0, "DOP853", time, rtol=1e-12, atol=1e-12).y.T
    u = np.column_stack([np.zeros_like(time), *link(time)])
    found = rollout(compile_model(model), x0, time, u, np.array(list(p.values())), 8)
    np.testing.assert_allclose(found[:, 0], exact[:, 0], atol=4e-4)


@pytest.mark.parametrize("name", MODELS)
def test_a_finer_run_agrees(name):
    model = build(name)
    x0, time, u = uneven_record(model)
    # friction ten times smoother than usual: of its turns even 64 steps see little
    smoother = {w_s: 10.0 * model.parameter(w_s).nominal for w_s in model.smoothing.values()}
    kernel, p = compile_model(model), values_of(model, **smoother)
    coarse, fine = (rollout(kernel, x0, time, u, p, s) for s in (64, 256))
    np.testing.assert_allclose(coarse / np.ptp(fine, axis=0), fine / np.ptp(fine, axis=0), atol=2e-5)


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("name", MODELS)
def test_sensitivities_are_those_of_the_discrete_run(name, substeps):
    """dX/dp against central differences of the run itself, whatever its step."""
    model = build(name)
    x0, time, u = uneven_record(model)
    # friction ten times smoother than usual, so that a finite difference sees a derivative and not a kink
    smoother = {w_s: 10.0 * model.parameter(w_s).nominal for w_s in model.smoothing.values()}
    kernel, p = compile_model(model), values_of(model, **smoother)
    X, Sp = rollout_sensitivities(kernel, x0, time, u, p, substeps)
    np.testing.assert_allclose(X, rollout(kernel, x0, time, u, p, substeps), atol=1e-12 * np.abs(X).max())
    assert kernel.sensitive == tuple(q.name for q in model.parameters if not q.fixed)

    for j, parameter in enumerate(kernel.sensitive):
        i = kernel.parameter_names.index(parameter)
        h = 1e-4 * abs(p[i]) or 1e-4 * model.parameter(parameter).spread
        up, down = (rollout(kernel, x0, time, u, p + d * np.eye(len(p))[i], substeps) for d in (h, -h))
        numeric = (up - down) / (2 * h)
        scale = np.abs(numeric).max(axis=0) + 1e-12 * np.ptp(X, axis=0) / h
        np.testing.assert_allclose(Sp[:, :, j] / scale, numeric / scale, atol=1e-5, err_msg=parameter)
        assert np.abs(Sp[:, :, j]).max() > 0.0, parameter


@pytest.mark.parametrize("name", MODELS)
def test_the_compiled_jacobian_is_that_of_the_derivative(name):
    model = build(name)
    x0, _, u = uneven_record(model)
    kernel, p = compile_model(model), values_of(model)
    values = SimpleNamespace(**dict(zip(model.parameter_names, p, strict=True)))
    A = np.empty((1, len(x0), len(x0)))
    kernel.module.jacobians(x0[None], u[:1], p, A)
    for i, state in enumerate(model.states):
        h = 1e-6 * state.scale * np.eye(len(x0))[i]
        up, down = (np.array(model.derivative(x, u[0], values, SmoothOps())) for x in (x0 + h, x0 - h))
        numeric = (up - down) / (2 * h[i])
        np.testing.assert_allclose(A[0, :, i], numeric, atol=1e-5 * max(np.abs(A).max(), 1.0), err_msg=state.name)


def test_a_gap_is_one_long_step():
    """Leaving out samples during which the inputs do not change leaves the rest of the run as it was."""
    model = build("dc_motor")
    x0, time, u = uneven_record(model)
    u[20:31] = u[20]
    keep = np.r_[0:21, 30 : len(time)]
    kernel, p = compile_model(model), values_of(model, tau_fc=0.0)
    whole = rollout(kernel, x0, time, u, p, 64)
    cut = rollout(kernel, x0, time[keep], u[keep], p, 64)
    np.testing.assert_allclose(cut, whole[keep], atol=1e-6 * np.abs(whole).max())


def test_wrong_shapes_are_named():
    model = build("dc_motor")
    x0, time, u = uneven_record(model)
    kernel, p = compile_model(model), values_of(model)
    with pytest.raises(JointIdError, match=r"x0 for model dc_motor must have shape \(2,\), not \(3,\)"):
        rollout(kernel, np.zeros(3), time, u, p)
    with pytest.raises(JointIdError, match=r"u for model dc_motor must have shape \(60, 2\), not \(59, 2\)"):
        rollout(kernel, x0, time, u[1:], p)
    with pytest.raises(JointIdError, match="substeps = 0: must be at least 1"):
        rollout_sensitivities(kernel, x0, time, u, p, 0)


def test_the_spectral_radius_is_that_of_the_eigenvalues():
    """Of stiff, oscillating and defective matrices; and infinite where a path has diverged."""
    module, rng = compile_model(build("harmonic_drive")).module, np.random.default_rng(0)
    for size in (1e-3, 1.0, 1e6):
        for A in rng.standard_normal((50, 4, 4)) * 10 ** rng.uniform(-4, 4, (50, 4, 4)) * size:
            assert module.spectral_radius(A[None].copy()) == pytest.approx(
                np.max(np.abs(np.linalg.eigvals(A))), rel=1e-7
            )
    A = np.zeros((2, 4, 4))
    A[0, 0, 1] = 1.0
    assert module.spectral_radius(A) == 0.0
    A[1] = 5.0 * np.eye(4)
    assert module.spectral_radius(A) == pytest.approx(5.0)
    A[0, 1, 1] = np.nan
    assert module.spectral_radius(A) == np.inf
