"""Simulation against closed forms, an independent integrator and its own finer runs."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson, solve_ivp
from scipy.linalg import expm

from joint_id_core.dormand_prince import step
from joint_id_core.errors import JointIdError
from joint_id_core.models import LAWS, DCMotor, Electromechanical, HarmonicDrive, Model, MotorSide, RigidJoint
from joint_id_core.operations import SignOps
from joint_id_core.signals import channel, positive
from joint_id_core.simulation import JointSimulator, simulate


def linear_response(a, b, x, time, u_start, u_end):
    """States of dx = a x + b u, u a straight line from u_start[k] to u_end[k] within step k (exact)."""
    n, m = b.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = a, b, np.eye(m)
    states = [x]
    for k, dt in enumerate(np.diff(time)):
        slope = (u_end[k] - u_start[k]) / dt
        states.append((expm(block * dt) @ np.concatenate([states[-1], u_start[k], slope]))[:n])
    return np.array(states)


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
    exact = linear_response(a, b, np.zeros(2), time, u[:-1], u[:-1])
    np.testing.assert_allclose(r["current"], exact[:, 0], atol=1e-6)
    np.testing.assert_allclose(r["motor_velocity"], exact[:, 1], atol=1e-5)


def test_first_order_hold_inputs_run_in_straight_lines_and_zero_order_ones_do_not():
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
    end = u[1:].copy()
    end[:, 0] = u[:-1, 0]
    exact = linear_response(a, b, np.zeros(2), time, u[:-1], end)
    np.testing.assert_allclose(r["motor_position"], exact[:, 0], atol=1e-6)
    np.testing.assert_allclose(r["motor_velocity"], exact[:, 1], atol=1e-4)


@pytest.mark.parametrize("w_0", [3.0, -3.0])
def test_mass_under_coulomb_friction_stops_at_the_exact_place_and_time(w_0):
    p = {"J": 2.0, "c": 0.0, "tau_f": 5.0}
    stop, place = 2.0 * 3.0 / 5.0, 2.0 * w_0 * 3.0 / (2 * 5.0)
    joint = JointSimulator(RigidJoint(), p, {"link_velocity": w_0})
    joint.advance(stop - 1e-9, {"torque": 0.0})
    assert 0.0 < joint.state["link_velocity"] / w_0 < 1e-8
    joint.advance(2e-9, {"torque": 0.0})
    assert joint.state["link_velocity"] == 0.0
    assert joint.modes == {"link_velocity": 0}
    joint.advance(5.0, {"torque": 4.999})
    assert joint.state["link_velocity"] == 0.0
    assert joint.state["link_position"] == pytest.approx(place, rel=1e-12)


def test_the_instant_of_stopping_is_found_to_a_picosecond_within_a_long_step():
    stop = 2.0 * 3.0 / 5.0
    time = np.array([0.0, 0.5, stop - 1e-11, stop + 1e-11, 1.7, 3.0])
    r = simulate(
        RigidJoint(), time, {"torque": np.zeros(6)}, {"J": 2.0, "c": 0.0, "tau_f": 5.0}, {"link_velocity": 3.0}
    )
    assert 0.0 < r["link_velocity"][2] < 1e-10
    np.testing.assert_array_equal(r["link_velocity"][3:], 0.0)


def test_a_velocity_that_dips_to_zero_within_one_step_sticks_there():
    # The force on the motor grows as 0.1 t through the damper: friction 0.02 stops it at 0.18 s, until 0.2 s.
    changes = {"k_1": 0.0, "k_2": 0.0, "c_1": 1e-10, "c_m": 0.0, "tau_fm": 0.02, "N": 1.0, "J_m": 6e-5}
    joint = JointSimulator(MotorSide(), changes, {"motor_velocity": 33.0}, rtol=1e-4)
    held = {"torque": 0.0, "link_position": 0.0, "link_velocity": 0.0}
    joint.advance(0.4, held, {"link_velocity": 0.4 * 1e9})
    assert joint.state["motor_velocity"] == pytest.approx(0.1 * 0.2**2 / 2 / 6e-5, rel=1e-5)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_motor_that_a_swinging_link_just_tears_loose_is_not_missed(sign):
    # The spring torque passes the friction for 0.2 ms only, within a step, at the turning point of the link.
    changes = {"k_2": 0.0, "c_1": 0.0, "c_q": 0.0, "tau_fq": 0.0}
    p = HarmonicDrive().values(changes)
    peak = 1.0001 * p["tau_fm"] * p["N"] / p["k_1"]  # link angle
    speed = sign * peak * math.sqrt(p["k_1"] / p["J_q"])
    joint = JointSimulator(HarmonicDrive(), changes, {"link_velocity": speed})
    joint.advance(0.03, {"torque": 0.0})
    assert sign * joint.state["motor_position"] > 0.0


def test_mass_under_coulomb_and_viscous_friction_stops_at_the_closed_form():
    j, c, tau_f, w_0 = 2.0, 3.0, 5.0, 4.0
    stop = j / c * math.log(1 + c * w_0 / tau_f)
    place = j * w_0 / c - tau_f * stop / c
    time = np.linspace(0, 2, 401)
    changes = {"J": j, "c": c, "tau_f": tau_f}
    r = simulate(RigidJoint(), time, {"torque": np.zeros(401)}, changes, {"link_velocity": w_0}, rtol=1e-10)
    moving = time < stop
    expected = (w_0 + tau_f / c) * np.exp(-c / j * time[moving]) - tau_f / c
    np.testing.assert_allclose(r["link_velocity"][moving], expected, rtol=1e-8, atol=1e-9)
    assert np.all(r["link_velocity"][~moving] == 0.0)
    assert np.all(r["link_position"][~moving] == r["link_position"][-1])
    assert r["link_position"][-1] == pytest.approx(place, rel=1e-9)


def test_square_pulses_make_slips_and_sticks_of_the_exact_length():
    # On for 0.1 s at twice the friction: it speeds up for 0.1 s, slows down for 0.1 s, sticks for 0.2 s.
    time, phase = np.arange(1600) * 1e-3, np.arange(1600) % 400 * 1e-3
    torque = np.where(phase < 0.0999, 10.0, 0.0)
    r = simulate(RigidJoint(), time, {"torque": torque}, {"J": 1.0, "c": 0.0, "tau_f": 5.0})
    stuck = (phase == 0.0) | (phase > 0.2005)
    assert np.all(r["link_velocity"][stuck] == 0.0)
    expected = 5.0 * np.minimum(phase, 0.2 - phase)
    np.testing.assert_allclose(r["link_velocity"][~stuck], expected[~stuck], atol=1e-9)
    assert r["link_position"][-1] == pytest.approx(4 * 5.0 * 0.1**2, rel=1e-9)


@given(share=st.floats(-0.999, 0.999), law=st.sampled_from(LAWS), dt=st.floats(1e-4, 1.0))
@settings(max_examples=40, deadline=None)
def test_a_joint_at_rest_below_its_friction_stays_exactly_at_rest(share, law, dt):
    joint = JointSimulator(RigidJoint(friction=law))
    for _ in range(3):
        joint.advance(dt, {"torque": 5.0 * share})
    assert joint.state == {"link_position": 0.0, "link_velocity": 0.0}


@pytest.mark.parametrize("sign", [1, -1])
def test_breakaway_under_a_torque_ramp_is_at_the_exact_instant(sign):
    # The link turns steadily and winds up the spring of a motor that sticks.
    model, changes = MotorSide(), {"k_2": 0.0, "c_1": 0.0}
    p = model.values(changes)
    rate = sign * 0.05
    instant = p["tau_fm"] * p["N"] / (p["k_1"] * abs(rate))
    start, end = {"torque": 0.0, "link_velocity": 0.0}, instant - 1e-9
    joint = JointSimulator(model, changes)
    joint.advance(end, {**start, "link_position": 0.0}, {"link_position": rate * end})
    assert joint.state == {"motor_position": 0.0, "motor_velocity": 0.0}
    joint.advance(2e-9, {**start, "link_position": rate * end}, {"link_position": rate * (end + 2e-9)})
    assert joint.modes == {"motor_velocity": sign}


def test_breakaway_while_the_current_builds_up_is_at_the_exact_instant():
    model = DCMotor()
    p = model.values()
    instant = -p["L"] / p["R"] * math.log(1 - p["R"] * p["tau_fc"] / p["k_t"])
    joint = JointSimulator(model, rtol=1e-11)
    joint.advance(instant - 1e-8, {"voltage": 1.0})
    assert joint.state["motor_velocity"] == 0.0
    joint.advance(2e-8, {"voltage": 1.0})
    assert joint.state["motor_velocity"] > 0.0


def test_stribeck_friction_holds_up_to_the_static_level_and_then_lets_go_for_good():
    changes = {"J": 1.0, "c": 0.0, "tau_f": 5.0, "dtau_s": 2.0, "w_b": 0.1}
    joint = JointSimulator(RigidJoint(friction="stribeck"), changes)
    joint.advance(1.0, {"torque": 6.999})
    assert joint.state["link_velocity"] == 0.0
    joint.advance(1.0, {"torque": 7.1})
    assert joint.state["link_velocity"] > 0.5
    before = joint.state["link_velocity"]
    joint.advance(1.0, {"torque": 6.0})  # less than the static, more than the sliding friction
    assert joint.state["link_velocity"] == pytest.approx(before + 1.0, rel=1e-6)


def test_a_velocity_without_coulomb_friction_never_sticks():
    r = simulate(RigidJoint(), np.linspace(0, 2, 101), {"torque": np.full(101, -1.0)},
                 {"J": 1.0, "c": 0.0, "tau_f": 0.0}, {"link_velocity": 1.0})  # fmt: skip
    np.testing.assert_allclose(r["link_velocity"], 1.0 - r.time, atol=1e-12)


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


def stick_slip_pull(rtol):
    """A motor pulled by a slowly turning link through its spring: it sticks, jumps, sticks."""
    model, time = MotorSide(friction="stribeck"), np.arange(0, 4, 2e-3)
    changes = {"k_2": 0.0, "c_1": 0.0, "c_m": 1e-4, "dtau_sm": 0.02, "w_bm": 2.0}
    inputs = {"torque": np.zeros(time.size), "link_position": 2e-3 * time, "link_velocity": np.zeros(time.size)}
    return model.values(changes), simulate(model, time, inputs, changes, rtol=rtol)


def test_stick_slip_alternates_and_agrees_with_a_finer_run():
    p, r = stick_slip_pull(1e-7)
    w, position = r["motor_velocity"], r["motor_position"]
    stuck = w == 0.0
    assert np.count_nonzero(np.diff(stuck.astype(int)) == -1) >= 3
    held = stuck[1:] & stuck[:-1]
    assert np.all(np.diff(position)[held] == 0.0)
    spring = p["k_1"] / p["N"] * (r["link_position"] - position / p["N"])
    level = p["tau_fm"] + p["dtau_sm"]
    assert np.all(np.abs(spring[stuck]) <= level * (1 + 1e-9))
    _, fine = stick_slip_pull(1e-11)
    np.testing.assert_allclose(position, fine["motor_position"], atol=1e-5 * np.ptp(position))


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


@dataclass(frozen=True)
class Shaker(Model):
    """A mass on dry friction under a force of 80 kHz: it starts and stops four times a period."""

    name = "shaker"
    states = (channel("motor_position"), channel("link_position"), channel("motor_velocity"))
    inputs = ()
    parameters = (positive("level", "Nm", "friction", 1.0), positive("w_s", "rad/s", "smoothing", 1.0))

    def derivative(self, x, u, p, ops):
        a, b, w = x
        omega = 2 * math.pi * 8e4
        return (omega * b, -omega * a, 1.3 * a - p.level * ops.direction("motor_velocity", w, p.w_s))


def test_endless_switching_ends_with_time_and_state():
    joint = JointSimulator(Shaker(), x0={"link_position": 1.0}, rtol=1e-4)
    with pytest.raises(JointIdError, match=r"at 0\.000\d+ s: more than 200 changes .*motor_velocity"):
        joint.advance(1.0, {})


@pytest.mark.parametrize(
    ("changes", "voltage", "message"),
    [
        ({"L": 1e-12}, 12.0, "too stiff"),
        ({"J_r": 0.0}, 12.0, "divides by zero.*J_r"),
        ({"L": 0.0}, 12.0, "divides by zero.*L"),
        ({}, 1e308, "not finite"),
        ({}, math.nan, "voltage = nan: must be finite"),
        ({"L": -1.0}, 12.0, "outside its bounds"),
        ({"k": 1.0}, 12.0, "no parameter 'k'"),
    ],
)
def test_what_cannot_be_simulated_ends_with_one_line(changes, voltage, message):
    with pytest.raises(JointIdError, match=message) as error:
        JointSimulator(DCMotor(), changes).advance(0.5, {"voltage": voltage})
    assert "\n" not in str(error.value)


def test_a_diverging_cubic_is_reported_with_time_and_state():
    with pytest.raises(JointIdError, match=r"simulation of harmonic_drive at .* s: .*motor_position"):
        JointSimulator(HarmonicDrive(), x0={"link_position": 1e120}).advance(1.0, {"torque": 0.0})


@pytest.mark.parametrize(
    ("time", "inputs", "message"),
    [
        ([0.0, 0.1], {}, "needs input 'voltage'"),
        ([0.0, 0.1], {"volts": [1.0, 1.0]}, "no input 'volts'"),
        ([0.0, 0.1], {"voltage": [1.0, 1.0, 1.0]}, r"shape \(3,\)"),
        ([0.0, 0.1], {"voltage": [1.0, math.nan]}, "voltage is nan at 0.1 s"),
        ([0.0], {"voltage": [1.0]}, "two instants"),
        ([0.0, 0.0], {"voltage": [1.0, 1.0]}, "time repeats"),
    ],
)
def test_bad_inputs_of_simulate(time, inputs, message):
    with pytest.raises(JointIdError, match=message):
        simulate(DCMotor(), np.array(time), {n: np.array(v) for n, v in inputs.items()})


def test_bad_calls_of_the_simulator():
    with pytest.raises(JointIdError, match="no state 'speed'"):
        JointSimulator(DCMotor(), x0={"speed": 1.0})
    with pytest.raises(JointIdError, match="rtol"):
        JointSimulator(DCMotor(), rtol=1.0)
    with pytest.raises(JointIdError, match=r"k_t .*no default"):
        JointSimulator(HarmonicDrive(actuation="current"))
    joint = JointSimulator(DCMotor())
    with pytest.raises(JointIdError, match="must be positive"):
        joint.advance(0.0, {"voltage": 1.0})
    with pytest.raises(JointIdError, match="voltage is held"):
        joint.advance(0.1, {"voltage": 1.0}, {"voltage": 2.0})
