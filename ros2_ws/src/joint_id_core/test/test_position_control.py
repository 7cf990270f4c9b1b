"""A joint under the position controller."""

import math

import numpy as np
import pytest

from joint_id_core.errors import JointIdError
from joint_id_core.models import DCMotor, HarmonicDrive, MotorSide, RigidJoint
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import ControlledJoint, PositionController, simulate_closed_loop
from joint_id_core.simulation.sensors import Sensors
from joint_id_core.simulation.simulator import simulate

TIME = np.arange(2000) * 2e-3


def moved(**kwargs):
    reference = position_reference(seed=1)
    return reference, simulate_closed_loop(HarmonicDrive(), PositionController(), reference, TIME, **kwargs)


def test_the_link_follows_the_reference_up_to_10_hz():
    reference, r = moved()
    q = r["link_position"]
    assert 0.3 < np.abs(q).max() < 0.5
    assert np.sqrt(np.mean((q - reference.value(TIME)) ** 2)) < 0.02
    second = np.fft.rfft(q[1000:]) / np.fft.rfft(reference.value(TIME[1000:]))
    for tone in reference.frequencies:
        assert 0.7 < abs(second[round(tone * 2.0)]) < 1.4, tone
    assert np.abs(r["torque"]).max() < 1.5  # the limit is not touched
    # Stable: the second period repeats the first once the start has died away.
    np.testing.assert_allclose(q[1500:], q[500:1000], atol=1e-3)


def test_the_recorded_torque_moves_the_model_exactly_as_recorded():
    _, r = moved()
    x0 = {name: r[name][0] for name in HarmonicDrive().state_names}
    again = simulate(HarmonicDrive(), TIME, {"torque": r["torque"]}, x0=x0)
    for s in HarmonicDrive().states:
        np.testing.assert_allclose(again[s.name], r[s.name], atol=1e-5 * s.scale, err_msg=s.name)


def test_the_joint_sees_the_recorded_torque_plus_white_noise_of_the_given_size():
    # Frictionless and rigid: the change of velocity over a period gives the torque that acted.
    changes = {"J": 1.4, "c": 0.0, "tau_f": 0.0, "N": 101.0}
    r = simulate_closed_loop(
        RigidJoint(), PositionController(), position_reference(), TIME, changes, torque_noise=0.02, seed=5
    )
    true = 1.4 * np.diff(r["link_velocity"]) / np.diff(TIME) / 101.0
    noise = true - r["torque"][:-1]
    assert noise.std() == pytest.approx(0.02, rel=0.07)
    assert abs(noise.mean()) < 4 * 0.02 / math.sqrt(noise.size)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 4 / math.sqrt(noise.size)


def test_a_seed_repeats_the_run_and_another_changes_it():
    runs = [moved(torque_noise=0.01, seed=s)[1]["motor_velocity"] for s in (1, 1, 2)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_the_controller_sees_what_the_sensors_show():
    sensors, control = Sensors(noise={"link_position": 1e-3, "motor_velocity": 0.5}), PositionController()
    exact, noisy = moved()[1], moved(sensors=sensors)[1]
    reference = position_reference(seed=1)
    for name, std in sensors.noise.items():
        assert np.std(np.diff(noisy[name] - exact[name])) > std  # white noise, twice that variance in differences
    for k, t in enumerate(TIME[:200]):
        shown = noisy["link_position"][k], noisy["motor_velocity"][k] / 101.0
        wanted = control.torque(float(reference.value(t)), float(reference.rate(t)), *shown)
        assert noisy["torque"][k] == pytest.approx(wanted, abs=1e-9)


def test_torque_is_limited():
    assert PositionController(limit=0.5).torque(1.0, 0.0, 0.0, 0.0) == 0.5
    assert PositionController(limit=0.5).torque(-1.0, 0.0, 0.0, 0.0) == -0.5
    assert PositionController(k_p=2.0, k_d=3.0).torque(0.1, 0.2, 0.05, 0.1) == pytest.approx(2 * 0.05 + 3 * 0.1)


def test_a_current_driven_joint_moves_as_the_torque_driven_one():
    _, r = moved()
    i = simulate_closed_loop(
        HarmonicDrive(actuation="current"), PositionController(), position_reference(seed=1), TIME, {"k_t": 0.1}
    )
    np.testing.assert_allclose(i["current"] * 0.1, r["torque"], atol=1e-4)


def test_one_tick_reports_the_command_it_held():
    joint = ControlledJoint(HarmonicDrive(), PositionController(), position_reference(), torque_noise=0.1)
    wanted = joint.command()
    assert joint.tick(0.002) == {"torque": wanted}
    assert joint.joint.time == 0.002


def test_a_joint_that_changes_goes_on_from_where_it_is():
    model, inputs = HarmonicDrive(actuation="current"), {"k_t": 0.1}
    joint = ControlledJoint(model, PositionController(), position_reference(), inputs)
    twin = ControlledJoint(model, PositionController(), position_reference(), inputs)
    for _ in range(100):
        joint.tick(0.002)
        twin.tick(0.002)
    before = joint.joint.state
    joint.change({"k_t": 0.05})
    assert joint.joint.state == before and joint.joint.time == twin.joint.time
    # The controller believes in its old torque constant: it reports the same current, but half the torque acts.
    assert joint.tick(0.002) == twin.tick(0.002)
    assert abs(joint.joint.state["motor_velocity"] - twin.joint.state["motor_velocity"]) > 0.01
    with pytest.raises(JointIdError, match="no parameter 'k'"):
        joint.change({"k": 1.0})


def test_a_change_to_the_same_parameters_is_none():
    joint, twin = (ControlledJoint(HarmonicDrive(), PositionController(), position_reference()) for _ in range(2))
    for k in range(200):
        if k == 77:
            joint.change()
        joint.tick(0.002)
        twin.tick(0.002)
    for s in HarmonicDrive().states:
        assert joint.joint.state[s.name] == pytest.approx(twin.joint.state[s.name], abs=1e-6 * s.scale), s.name


@pytest.mark.parametrize("model", [DCMotor(), MotorSide()])
def test_models_without_a_link_cannot_be_position_controlled(model):
    with pytest.raises(JointIdError, match=f"{model.name} cannot be position controlled"):
        ControlledJoint(model, PositionController(), position_reference())


def test_bad_arguments():
    with pytest.raises(JointIdError, match="torque_noise = -1"):
        moved(torque_noise=-1.0)
    with pytest.raises(JointIdError, match="no parameter 'k'"):
        moved(values={"k": 1.0})
    with pytest.raises(JointIdError, match="two instants"):
        simulate_closed_loop(HarmonicDrive(), PositionController(), position_reference(), np.array([0.0]))
