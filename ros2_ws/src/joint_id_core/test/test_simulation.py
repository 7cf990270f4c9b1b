"""Simulation against closed forms, an independent integrator and its own finer runs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson, solve_ivp

from joint_id_core.models import LAWS, DCMotor, Electromechanical, HarmonicDrive, MotorSide, RigidJoint
from joint_id_core.models.curved_inputs import curved
from joint_id_core.models.operations import SignOps
from joint_id_core.simulation.dormand_prince import step
from joint_id_core.simulation.simulator import JointSimulator, simulate

from .linear_systems import exact_linear


def uneven(count, seed=0):
    return np.concatenate([[0.0], np.cumsum(np.random.default_rng(seed).uniform(5e-4, 6e-3, count - 1))])


def test_dc_motor_without_friction_follows_the_matrix_exponential():
    time = uneven(60)
    voltage = np.random.default_rng(1).uniform(-12, 12, time.size)
    load = np.random.default_rng(2).uniform(-0.1, 0.1, time.size)
    model = DCMotor()
    p = model.values({"tau_fc": 0.0})
    r = simulate(model, time, {"voltage": voltage, "external_torque": load}, {"tau_fc": 0.0}, rtol=1e-9)
    a = np.array([[-p["R"] / p["L"], -p["k_b"] / p["L"]], [p["k_t"] / p["J_r"], -p["c_b"] / p["J_r"]]])
    b = np.diag([1 / p["L"], -1 / p["J_r"]])
    u = np.column_stack([voltage, load])
    exact = exact_linear(a, b, np.zeros(2), time, u, [False, False], [None, None])
    np.testing.assert_allclose(r["current"], exact[:, 0], atol=1e-6)
    np.testing.assert_allclose(r["motor_velocity"], exact[:, 1], atol=1e-5)


def test_a_measured_motion_runs_on_between_samples_and_a_drive_is_held():
    time = uneven(60)
    rng = np.random.default_rng(3)
    u = np.column_stack([rng.normal(0, 0.1, time.size), rng.normal(0, 1e-3, time.size), rng.normal(0, 0.1, time.size)])
    u[10:20], u[40:45] = u[10], u[40]  # constant for some samples, then on
    model, changes = MotorSide(), {"tau_fm": 0.0, "k_2": 0.0}
    p = model.values(changes)
    r = simulate(model, time, dict(zip(model.input_names, u.T, strict=True)), changes, rtol=1e-9)
    n, j = p["N"], p["J_m"]
    a = np.array([[0, 1], [-p["k_1"] / n**2 / j, -(p["c_1"] / n**2 + p["c_m"]) / j]])
    b = np.array([[0, 0, 0], [1 / j, p["k_1"] / n / j, p["c_1"] / n / j]])
    u = curved(model, time, u)
    exact = exact_linear(a, b, np.zeros(2), time, u, [False, True, True], [None, 2, None])
    np.testing.assert_allclose(r["motor_position"], exact[:, 0], atol=1e-6)
    np.testing.assert_allclose(r["motor_velocity"], exact[:, 1], atol=1e-4)


def sign_reference(model, values, x0, u, time):
    """States by scipy's integrator with the sign function: right only while no velocity reaches zero."""
    p, ops = type("P", (), values), SignOps()
    run = solve_ivp(
        lambda _, x: model.derivative(x.tolist(), u, p, ops), (0, time[-1]), x0, "DOP853", time, rtol=1e-11, atol=1e-13
    )
    return run.y


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("model", "u", "x0"),
    [
        (HarmonicDrive, {"torque": 0.3, "external_torque": 5.0}, {"motor_velocity": 40.0, "link_velocity": 0.4}),
        (Electromechanical, {"voltage": 12.0}, {"motor_velocity": 20.0, "link_velocity": 0.2}),
        (RigidJoint, {"torque": 30.0}, {"link_velocity": -10.0}),
    ],
)
def test_smooth_stretches_agree_with_scipy(model, u, x0, law):
    model, time = model(friction=law), np.linspace(0, 0.1, 51)
    r = simulate(model, time, {n: np.full(51, v) for n, v in u.items()}, None, x0, rtol=1e-9)
    reference = sign_reference(
        model,
        model.values(),
        [x0.get(n, 0.0) for n in model.state_names],
        [u.get(n, 0.0) for n in model.input_names],
        time,
    )
    for name, states in zip(model.state_names, reference, strict=True):
        np.testing.assert_allclose(r[name], states, rtol=1e-7, atol=1e-7 * np.abs(states).max(), err_msg=name)


def test_model_3_step_from_rest_agrees_with_a_finer_run():
    time = np.arange(0, 0.5, 1e-3)
    volts = {"voltage": np.full(time.size, 12.0)}
    coarse, fine = simulate(Electromechanical(), time, volts), simulate(Electromechanical(), time, volts, rtol=1e-11)
    for s in Electromechanical().states:
        spread = np.abs(fine[s.name]).max()
        np.testing.assert_allclose(coarse[s.name], fine[s.name], atol=1e-6 * spread, err_msg=s.name)
    # At steady speed V = R i + k_b w and the torque of the current balances friction.
    p = Electromechanical().values()
    i, w = fine["current"][-1], fine["motor_velocity"][-1]
    assert p["R"] * i + p["k_b"] * w == pytest.approx(12.0, rel=1e-3)


def test_energy_put_in_is_energy_stored_and_dissipated():
    time = np.arange(0, 1, 5e-5)
    torque = np.where(time < 0.5, 0.4, -0.2)
    r = simulate(HarmonicDrive(), time, {"torque": torque}, rtol=1e-10)
    p = HarmonicDrive().values()
    w_m, w_q = r["motor_velocity"], r["link_velocity"]
    twist, rate = r["motor_position"] / p["N"] - r["link_position"], w_m / p["N"] - w_q
    stored = p["J_m"] * w_m**2 / 2 + p["J_q"] * w_q**2 / 2 + p["k_1"] * twist**2 / 2 + p["k_2"] * twist**4 / 4
    lost = p["c_m"] * w_m**2 + p["tau_fm"] * abs(w_m) + p["c_q"] * w_q**2 + p["tau_fq"] * abs(w_q) + p["c_1"] * rate**2
    power = np.where(np.arange(time.size) < np.searchsorted(time, 0.5), 0.4, -0.2) * w_m - lost
    half = np.searchsorted(time, 0.5)
    # The torque jumps at `half`, just after that sample's left limit: integrate each side by itself.
    left = power[: half + 1].copy()
    left[-1] = 0.4 * w_m[half] - lost[half]
    work = simpson(left, x=time[: half + 1]) + simpson(power[half:], x=time[half:])
    assert stored.max() > 0.5
    assert stored[-1] - stored[0] == pytest.approx(work, abs=1e-5 * stored.max())


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_mirrored_inputs_give_exactly_the_mirrored_motion(seed):
    time = np.arange(30) * 4e-3
    torque = np.random.default_rng(seed).normal(0, 0.1, 30)
    a = simulate(HarmonicDrive(), time, {"torque": torque})
    b = simulate(HarmonicDrive(), time, {"torque": -torque})
    for name in HarmonicDrive().state_names:
        np.testing.assert_array_equal(a[name], -b[name])


@given(cuts=st.lists(st.floats(0.001, 0.299), min_size=1, max_size=8, unique=True))
@settings(max_examples=15, deadline=None)
def test_calls_of_any_length_give_the_same_motion(cuts):
    whole, parts = JointSimulator(HarmonicDrive()), JointSimulator(HarmonicDrive())
    whole.advance(0.3, {"torque": 0.2})
    for dt in np.diff([0.0, *sorted(cuts), 0.3]):
        if dt > 0.0:
            parts.advance(float(dt), {"torque": 0.2})
    assert parts.time == pytest.approx(0.3, abs=1e-12)
    for name, value in whole.state.items():
        assert parts.state[name] == pytest.approx(value, rel=1e-5, abs=1e-8), name


def test_sampling_does_not_change_the_motion_and_leaves_no_gap():
    fine = np.arange(501) * 1e-3
    kept = np.array([0, 1, 2, 7, 100, 101, 350, 500])
    volts = np.full(501, 12.0)
    a = simulate(Electromechanical(), fine, {"voltage": volts})
    b = simulate(Electromechanical(), fine[kept], {"voltage": volts[kept]})
    np.testing.assert_array_equal(b.time, fine[kept])
    for name in Electromechanical().state_names:
        assert np.all(np.isfinite(a[name]))
        np.testing.assert_allclose(b[name], a[name][kept], rtol=1e-12, atol=1e-15)


def test_a_500_hz_tick_costs_few_evaluations_of_the_model():
    calls = 0

    class Counted(HarmonicDrive):
        def derivative(self, x, u, p, ops):
            nonlocal calls
            calls += 1
            return super().derivative(x, u, p, ops)

    joint = JointSimulator(Counted())
    for k in range(500):
        joint.advance(2e-3, {"torque": 0.2 * math.sin(0.02 * k)})
    assert calls < 500 * 25  # two to four steps of six evaluations a tick


def test_a_joint_at_rest_under_a_constant_input_costs_one_evaluation_and_keeps_time():
    calls = 0

    class Counted(HarmonicDrive):
        def derivative(self, x, u, p, ops):
            nonlocal calls
            calls += 1
            return super().derivative(x, u, p, ops)

    joint = JointSimulator(Counted(), x0={"motor_position": 101.0, "link_position": 1.0})
    joint.advance(2e-3, {"torque": 0.01})
    calls = 0
    for _ in range(500):
        joint.advance(2e-3, {"torque": 0.01})
    assert calls <= 1
    assert joint.time == pytest.approx(1.002, rel=1e-12)
    assert joint.state == {"motor_position": 101.0, "link_position": 1.0, "motor_velocity": 0.0, "link_velocity": 0.0}
    # It is not asleep: a torque above the friction moves it as if it had not rested.
    rested, fresh = joint, JointSimulator(HarmonicDrive(), x0={"motor_position": 101.0, "link_position": 1.0})
    for j in (rested, fresh):
        j.advance(0.02, {"torque": 0.05})
    assert rested.state["motor_velocity"] > 1.0
    for name, value in fresh.state.items():
        assert rested.state[name] == pytest.approx(value, rel=1e-6), name


def test_the_recording_holds_states_and_inputs_as_measured_channels():
    time = np.arange(5) * 1e-3
    r = simulate(DCMotor(), time, {"voltage": np.arange(5.0)})
    assert set(r.channels) == {"current", "motor_velocity", "voltage", "external_torque"}
    assert all(r.measured(name) for name in r.channels)
    np.testing.assert_array_equal(r["voltage"], np.arange(5.0))
    np.testing.assert_array_equal(r["external_torque"], 0.0)


def test_dormand_prince_is_of_order_5_and_its_dense_output_of_order_4():
    def oscillator(_, x):
        return [x[1], -x[0]]

    def distance(x, t):
        return math.hypot(x[0] - math.cos(t), x[1] + math.sin(t))

    def errors(count):
        """Error at the end, and the largest one that a step adds within itself by interpolation."""
        h, x, added = 2.0 / count, [1.0, 0.0], 0.0
        for k in range(count):
            start = [math.cos(k * h), -math.sin(k * h)]
            inside = step(oscillator, k * h, start, oscillator(0, start), h).interpolant()(0.3)
            added = max(added, distance(inside, (k + 0.3) * h))
            x = step(oscillator, k * h, x, oscillator(0, x), h).y_1
        return distance(x, 2.0), added

    (end_1, added_1), (end_2, added_2) = errors(10), errors(20)
    assert math.log2(end_1 / end_2) == pytest.approx(5.0, abs=0.1)
    assert math.log2(added_1 / added_2) == pytest.approx(5.0, abs=0.2)  # h^5 within a step is order 4
