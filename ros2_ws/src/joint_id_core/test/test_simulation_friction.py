"""Simulation of joints that stop, stick and break away, against closed forms and finer runs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.models import LAWS, DCMotor, HarmonicDrive, MotorSide, RigidJoint
from joint_id_core.simulation.simulator import JointSimulator, simulate


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
