"""The innovations recursion against an exact Kalman filter, and in its two limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from joint_id_core.cell.kernel import compile_model
from joint_id_core.cell.rollout import rollout, rollout_sensitivities
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators.innovations.recursion import Recursion
from joint_id_core.estimators.shared.fit_data import SETTLE_S, prepare
from joint_id_core.models import build

MODEL = build("dc_motor")
TRUTH = MODEL.values({"tau_fc": 0.0})
FREE = ("R", "k_b", "k_t", "c_b")
NOISE = {"current": 0.05, "motor_velocity": 0.5}
R = np.square(list(NOISE.values()))
Q = np.square([0.3, 0.02])
LEVELS = np.concatenate([R, Q])
SUBSTEPS = 60  # RK4 then agrees with the matrix exponential, also over the gaps


def discrete(p, dt):
    """x' = A x + B u over dt with held inputs, by the matrix exponential."""
    big = np.zeros((4, 4))
    big[:2, :2] = [[-p["R"] / p["L"], -p["k_b"] / p["L"]], [p["k_t"] / p["J_r"], -p["c_b"] / p["J_r"]]]
    big[:2, 2:] = np.diag([1 / p["L"], -1 / p["J_r"]])
    whole = expm(big * dt)
    return whole[:2, :2], whole[:2, 2:]


def make_problem(seed=0, samples=250, volts=6.0):
    """The motor without Coulomb friction, so linear: noisy inputs and labels, some missing, two gaps."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) * 1e-3
    u = np.column_stack([volts * np.sign(np.sin(60 * time)) + volts, 0.02 * rng.standard_normal(samples)])
    x = np.zeros((samples, 2))
    A, B = discrete(TRUTH, 1e-3)
    for k in range(samples - 1):
        x[k + 1] = A @ x[k] + B @ (u[k] + np.sqrt(Q) * rng.standard_normal(2))
    y = x + rng.standard_normal(x.shape) * np.sqrt(R)
    y[rng.random(y.shape) < 0.1] = np.nan
    keep = np.r_[0:80, 84:170, 171:samples]
    channels = {"voltage": u[:, 0], "external_torque": u[:, 1], "current": y[:, 0], "motor_velocity": y[:, 1]}
    record = Recording(time[keep], {n: v[keep] for n, v in channels.items()})
    return prepare(MODEL, record, ParameterSettings({"tau_fc": 0.0}, fixed=("tau_fc",)))


@pytest.fixture
def recursion():
    """With a start and a state noise that the Kalman filter below can be given as they are."""
    made = Recursion(make_problem(), compile_model(MODEL))
    made.x0, made.P0, made.Q_x = np.array([0.1, -0.4]), np.diag([0.3, 20.0]), np.array([1e-5, 1e-3])
    return made


def kalman(recursion, p, gains=None):
    """Textbook filter with joint updates: -2 log L, whitened innovations, predictions, states, gains.

    With `gains` these are used instead of its own, which is how the derivative with frozen gain is defined.
    """
    a = recursion.data
    x, P = recursion.x0, recursion.P0
    cost, white, predicted, filtered, used, roots = 0.0, [], [], [], [], []
    for k in range(len(a.time)):
        seen = np.isfinite(a.y[k])
        C = np.eye(2)[seen]
        S = C @ P @ C.T + np.diag(R[seen])
        e = a.y[k, seen] - x[seen]
        K = P @ C.T @ np.linalg.inv(S) if gains is None else gains[k]
        cost += e @ np.linalg.solve(S, e) + np.linalg.slogdet(S)[1]
        root = np.linalg.cholesky(S)
        white.append(np.linalg.solve(root, e))
        roots.append(root)
        predicted.append(x[seen])
        used.append(K)
        x, P = x + K @ e, (np.eye(2) - K @ C) @ P @ (np.eye(2) - K @ C).T + K @ np.diag(R[seen]) @ K.T
        filtered.append(x)
        if k + 1 < len(a.time):
            A, B = discrete(p, a.time[k + 1] - a.time[k])
            q = Q + a.gap[k] * (a.u[k + 1] - a.u[k]) ** 2
            x, P = A @ x + B @ a.u[k], A @ P @ A.T + B @ np.diag(q) @ B.T + np.diag(recursion.Q_x)
    return cost, np.concatenate(white), predicted, np.array(filtered), used, roots


def free_values(p=TRUTH):
    return np.array([p[n] for n in FREE])


def test_cost_is_the_exact_likelihood_of_a_linear_model(recursion):
    """-2 log L without its constant, missing labels and gaps included; so are innovations and states."""
    assert np.isnan(recursion.data.y).any() and recursion.data.gap.sum() == 5
    found = recursion.run(free_values(), LEVELS, SUBSTEPS)
    cost, white, _, filtered, _, _ = kalman(recursion, TRUTH)
    assert found.cost == pytest.approx(cost, rel=1e-7)
    np.testing.assert_allclose(found.residuals[np.isfinite(recursion.data.y)], white, atol=1e-5)
    np.testing.assert_allclose(found.states, filtered, atol=1e-6 * np.abs(filtered).max())


def test_after_a_long_gap_the_record_begins_anew():
    """Cost, scores and sensitivities are then those of two records with the same parameters.

    The first samples of the second one tell its state only.
    """
    whole = make_problem().recording
    parts = [whole.window(0.0, 0.0795), whole.window(0.0895, 1.0)]
    cut = Recording(
        np.concatenate([part.time for part in parts]),
        {name: np.concatenate([part[name] for part in parts]) for name in whole.channels},
    )
    kernel = compile_model(MODEL)
    both, *alone = (
        Recursion(prepare(MODEL, r, ParameterSettings({"tau_fc": 0.0}, fixed=("tau_fc",))), kernel)
        for r in (cut, *parts)
    )
    for part in alone:  # their spread and state noise come from the range of the labels, which the cut record shares
        part.P0, part.Q_x = both.P0, both.Q_x
    later = alone[1].data
    vars(later)["settling"] = np.flatnonzero(later.time < later.time[0] + SETTLE_S)
    found, *each = (r.run(free_values(), LEVELS, SUBSTEPS) for r in (both, *alone))
    assert found.cost == pytest.approx(sum(part.cost for part in each), rel=1e-12)
    np.testing.assert_allclose(found.hessian, sum(part.hessian for part in each), rtol=1e-9)
    np.testing.assert_allclose(found.gradient, sum(part.gradient for part in each), rtol=1e-9)
    noise, *of_each = (
        r.noise_information(p, with_parameters=True) for r, p in zip((both, *alone), (found, *each), strict=True)
    )
    for whole_part, parts in zip(noise, zip(*of_each, strict=True), strict=True):
        np.testing.assert_allclose(whole_part, sum(parts), rtol=1e-9)


def by_parameters(recursion):
    """Derivatives of the whitened predictions by the parameters: central differences of the filter with its own gains
    held."""
    _, _, _, _, gains, roots = kalman(recursion, TRUTH)
    columns = []
    for name in FREE:
        h = 1e-5 * TRUTH[name]
        up, down = (kalman(recursion, {**TRUTH, name: TRUTH[name] + d}, gains)[2] for d in (h, -h))
        slope = [np.linalg.solve(r, (a - b) / (2 * h)) for r, a, b in zip(roots, up, down, strict=True)]
        columns.append(np.concatenate(slope))
    return np.column_stack(columns)


def test_gradient_and_matrix_are_those_of_the_predictions_with_frozen_gain(recursion):
    found = recursion.run(free_values(), LEVELS, SUBSTEPS)
    white, J = kalman(recursion, TRUTH)[1], by_parameters(recursion)
    scale = np.sqrt(np.diag(J.T @ J))
    np.testing.assert_allclose(found.hessian / np.outer(scale, scale), J.T @ J / np.outer(scale, scale), atol=1e-5)
    np.testing.assert_allclose(found.gradient / scale, J.T @ white / scale, atol=1e-4)


def test_responses_to_disturbances_are_those_to_other_inputs(recursion):
    """A linear model's gains do not depend on its inputs: what shifted inputs predict differs by the response alone."""
    a = recursion.data
    a.gap[:] = 0.0  # over a gap the gains depend on how much the inputs change
    T = np.arange(len(a.time))
    channel, course = np.array([0, 1, 1]), np.column_stack([np.sin(0.05 * T), np.ones(len(T)), np.cos(0.02 * T)])
    found = recursion.run(free_values(), LEVELS, SUBSTEPS)
    cross, total, score = recursion.disturbances(found, channel, course)
    columns, seen = [], np.isfinite(a.y)
    for c, shape in zip(channel, course.T, strict=True):
        a.u[:, c] += shape
        shifted = recursion.run(free_values(), LEVELS, SUBSTEPS)
        a.u[:, c] -= shape
        columns.append(((found.errors - shifted.errors) / np.sqrt(found.variances))[seen])
    D, J = np.column_stack(columns), by_parameters(recursion)
    size, scale = np.sqrt(np.diag(D.T @ D)), np.sqrt(np.diag(J.T @ J))
    np.testing.assert_allclose(total, D.T @ D, atol=1e-9 * size.max() ** 2)
    np.testing.assert_allclose(score, D.T @ found.residuals[seen], atol=1e-9 * size.max())
    np.testing.assert_allclose(cross / np.outer(scale, size), J.T @ D / np.outer(scale, size), atol=1e-4)


def cost_at(recursion, levels):
    return recursion.run(free_values(), levels, SUBSTEPS).cost


def test_score_is_the_derivative_of_the_likelihood_by_the_noise_levels(recursion):
    score = recursion.noise_information(recursion.run(free_values(), LEVELS, SUBSTEPS)).score
    for k, step in enumerate(np.diag(1e-4 * LEVELS)):
        slope = (cost_at(recursion, LEVELS + step) - cost_at(recursion, LEVELS - step)) / 2e-4
        assert -2.0 * score[k] == pytest.approx(slope, rel=1e-5)


def test_information_of_the_noise_levels_is_the_mean_curvature_of_the_likelihood():
    """Averaged over records, half the second derivative of the cost at the true levels (scaled to logarithms)."""
    curvature, information = np.zeros((4, 4)), np.zeros((4, 4))
    for seed in range(6):
        r = Recursion(make_problem(seed, 600), compile_model(MODEL))
        information += r.noise_information(r.run(free_values(), LEVELS, 8)).matrix
        for k, step in enumerate(np.diag(0.01 * LEVELS)):
            up, down = (
                r.noise_information(r.run(free_values(), LEVELS + d, 8)).score / (LEVELS + d) for d in (step, -step)
            )
            curvature[k] -= (up - down) / 0.02 * LEVELS
    shown = np.sqrt(np.diag(information))
    np.testing.assert_allclose(curvature / np.outer(shown, shown), information / np.outer(shown, shown), atol=0.15)


def test_information_on_parameters_and_levels_together_is_the_mean_slope_of_the_score():
    """How the gradient of the parameters falls with the logarithm of each level, averaged over records.

    Noise alone moves the motor: only then does it matter.
    """
    slope, cross, hessian, matrix = np.zeros((len(FREE), 4)), np.zeros((len(FREE), 4)), 0.0, 0.0
    for seed in range(20):
        r = Recursion(make_problem(seed, 600, volts=0.0), compile_model(MODEL))
        for k, step in enumerate(np.diag(np.full(4, 0.01))):
            up, down = (r.run(free_values(), LEVELS * np.exp(by), 8).gradient for by in (step, -step))
            slope[:, k] -= (up - down) / 0.02
        here = r.run(free_values(), LEVELS, 8)
        found = r.noise_information(here, with_parameters=True)
        hessian, matrix, cross = hessian + here.hessian, matrix + found.matrix, cross + found.cross
        whole = np.block([[here.hessian, found.cross], [found.cross.T, found.matrix]])
        scale = 1.0 / np.sqrt(np.diag(whole))
        assert np.linalg.eigvalsh(whole * np.outer(scale, scale)).min() > -1e-9
    size = np.sqrt(np.outer(np.diag(hessian), np.diag(matrix)))
    np.testing.assert_allclose(slope / size, cross / size, atol=0.05)
    assert np.max(np.abs(cross / size)) > 0.2  # there is something to compare


def test_noise_information_is_refused_for_an_older_pass(recursion):
    old = recursion.run(free_values(), LEVELS, SUBSTEPS)
    recursion.run(free_values(), LEVELS, SUBSTEPS)
    with pytest.raises(JointIdError, match="latest pass"):
        recursion.noise_information(old)


def test_without_feedback_it_is_the_simulation_error(recursion):
    """K = 0: residuals and Jacobian are those of the paper's network, the cost is weighted least squares."""
    recursion.P0, recursion.Q_x = np.zeros((2, 2)), np.zeros(2)
    a, p = recursion.data, free_values() * [1.2, 0.9, 1.1, 1.5]
    recursion.data.gap[:] = 0.0  # over a gap the input is uncertain, which alone would feed labels back
    found = recursion.run(p, np.concatenate([R, np.zeros(2)]), 3)
    arguments = (recursion.kernel, recursion.x0, a.time, a.u, recursion.values(p), 3)
    X, Sp = rollout_sensitivities(*arguments)
    error = a.y - X
    np.testing.assert_allclose(found.residuals, np.nan_to_num(error) / np.sqrt(R), atol=1e-9)
    np.testing.assert_allclose(found.states, rollout(*arguments), atol=1e-9)
    seen = np.isfinite(a.y)
    order = [recursion.kernel.sensitive.index(name) for name in FREE]
    J = np.where(seen[:, :, None], Sp[:, :, order] / np.sqrt(R)[:, None], 0.0).reshape(-1, len(FREE))
    np.testing.assert_allclose(found.hessian, J.T @ J, rtol=1e-9)
    np.testing.assert_allclose(found.gradient, J.T @ found.residuals.ravel(), rtol=1e-7)
    squares = np.nansum(error**2 / R) + np.sum(seen * np.log(R))
    assert found.cost == pytest.approx(squares, rel=1e-10)


def test_with_full_feedback_it_is_the_one_step_equation_error(recursion):
    """K = 1: every sample is predicted from the labels of the one before."""
    a = recursion.data
    a.y[:] = np.nan_to_num(a.y)  # whatever the labels are
    big = np.array([1e12, 1e12])
    found = recursion.run(free_values(), np.concatenate([R, big]), 3)
    np.testing.assert_allclose(found.states[1:], a.y[1:], atol=1e-6)
    steps = [
        rollout(recursion.kernel, a.y[k], a.time[k : k + 2], a.u[k : k + 2], recursion.values(free_values()), 3)[1]
        for k in range(len(a.time) - 1)
    ]
    # The variance depends on the length of the step alone, so residuals are the errors over a constant.
    ratio = ((a.y[1:] - np.array(steps)) / found.residuals[1:])[a.gap[:-1] == 0, 0][1:]
    np.testing.assert_allclose(ratio, np.median(ratio), rtol=1e-5)


def test_a_path_that_blows_up_says_so(recursion):
    """A resistance far too large makes the step unstable: the cost is not finite, nothing crashes."""
    cost = recursion.run(np.array([1e9, 1.0, 1.0, 1.0]), LEVELS, 1).cost
    assert not np.isfinite(cost)
