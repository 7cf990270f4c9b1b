"""The robot that is emulated: its motion, its sensors, what stops and brakes do."""

import math

import numpy as np
import pytest

from joint_id_core.data.recording import Recording
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.reference import START_S, STOP_S, TICK_S
from joint_id_core.emulator.robots import HOME, ROBOTS, build_joints
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ParameterSettings, fit
from joint_id_core.models import HarmonicDrive
from joint_id_core.results.estimate import Verdict
from joint_id_core.rtde.fields import FIELDS
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController

N = 101.0
ENCODER = 2 * math.pi / 2**19  # rad, a step
MOVING = (0, 3)


def built(robot="ur3e", moving=MOVING, amplitude=0.3, version=(5, 23, 0, 0), **changes):
    return Controller(build_joints(robot), moving, amplitude, version, **changes)


def run(controller, ticks, truth=False):
    """What is reported at each tick, by field, shape (ticks, 6) or (ticks,); with `truth` also the true states."""
    rows = []
    for _ in range(ticks):
        controller.tick()
        controller.report()
        row = {name: controller.values[name] for name in FIELDS}
        row["motor_position"] = [controller.values[f"output_double_register_{k}"] for k in range(24, 30)]
        row["motor_velocity"] = [controller.values[f"output_double_register_{k}"] for k in range(30, 36)]
        if truth:
            for name in ("motor_position", "link_position", "motor_velocity", "link_velocity"):
                row[f"true_{name}"] = getattr(controller.arm.joints, name)
            row["true_current"] = controller.arm.current
        rows.append({name: np.array(value, dtype=float) for name, value in row.items()})
        controller.advance()
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.fixture(scope="module")
def motion():
    """Six seconds from power-up on."""
    return run(built(), 3000, truth=True)


def test_the_links_follow_their_references(motion):
    late = motion["timestamp"] > 1.0
    np.testing.assert_array_equal(motion["timestamp"], np.arange(3000) * 0.002)
    for j in MOVING:
        wave = position_reference(0.3, seed=1 + j)
        # The start takes half its time longer than a motion at full speed from the beginning.
        expected = HOME[j] + wave.value(motion["timestamp"] - START_S / 2)
        np.testing.assert_allclose(motion["target_q"][late, j], expected[late], atol=1e-6)
        error = motion["actual_q"][late, j] - expected[late]
        assert error.std() < 0.02 < 0.1 < np.ptp(motion["actual_q"][late, j])
    assert not np.allclose(motion["target_q"][:, 0] - HOME[0], motion["target_q"][:, 3] - HOME[3])


def test_the_motion_starts_from_rest_without_a_jump(motion):
    np.testing.assert_array_equal(motion["target_qd"][0], 0.0)
    np.testing.assert_array_equal(motion["true_motor_velocity"][0], 0.0)
    np.testing.assert_allclose(motion["true_motor_position"][0], motion["true_link_position"][0] * N, rtol=1e-15)
    step = abs(np.diff(motion["target_q"], axis=0)).max()
    assert step < 1.05 * abs(motion["target_qd"]).max() * TICK_S
    assert abs(motion["true_current"][:250]).max() < 1.5 * abs(motion["true_current"][500:]).max()


def test_targets_are_derivatives_of_each_other(motion):
    for name, rate in (("target_q", "target_qd"), ("target_qd", "target_qdd")):
        middle = (motion[name][2:] - motion[name][:-2]) / (2 * TICK_S)
        np.testing.assert_allclose(middle, motion[rate][1:-1], atol=0.02 * abs(motion[rate]).max())


def test_joints_that_do_not_move_rest_exactly_and_their_currents_show_the_noise_of_the_sensors(motion):
    rest = [j for j in range(6) if j not in MOVING]
    for name in ("true_motor_velocity", "true_link_velocity"):
        np.testing.assert_array_equal(motion[name][:, rest], 0.0)
    np.testing.assert_array_equal(motion["true_link_position"][:, rest], np.tile(np.array(HOME)[rest], (3000, 1)))
    drives, control = build_joints("ur3e"), PositionController()
    for j in rest:
        position, velocity = math.hypot(2.0e-5, ENCODER / math.sqrt(12)), 1.5e-3
        std = drives[j].size * math.hypot(control.k_p * position, control.k_d * velocity) / drives[j].values["k_t"]
        current = motion["true_current"][:, j]
        assert current.std() == pytest.approx(std, rel=0.06)
        # Home is not on a step of the encoder: half a step is the most it shows all the time.
        offset = drives[j].size * control.k_p * 0.5 * ENCODER / drives[j].values["k_t"]
        assert abs(current.mean()) < offset + 4 * std / math.sqrt(3000)


def test_actual_qd_is_the_motor_side_behind_the_gear(motion):
    turned = np.concatenate([np.zeros((1, 6)), np.cumsum(motion["actual_qd"][1:] + motion["actual_qd"][:-1], axis=0)])
    integral = 0.5 * TICK_S * turned
    motor = (motion["motor_position"] - motion["motor_position"][0]) / N
    walk = 1.5e-3 * TICK_S * math.sqrt(3000)  # of the noise
    difference = integral - motor
    assert abs(difference).max() < 5 * walk
    # The link is not there: the gear is twisted by much more than that.
    link = motion["actual_q"] - motion["actual_q"][0]
    assert abs(integral - link)[:, 0].max() > 10 * walk
    np.testing.assert_allclose(motion["motor_velocity"], motion["actual_qd"] * N, rtol=1e-12)


@pytest.mark.parametrize(
    ("shown", "true", "scale", "std"),
    [
        ("actual_q", "true_link_position", 1.0, math.hypot(2.0e-5, ENCODER / math.sqrt(12))),
        ("actual_qd", "true_motor_velocity", 1 / N, 1.5e-3),
        ("actual_current", "true_current", 1.0, 0.010),
        ("motor_position", "true_motor_position", 1.0, math.hypot(2.0e-5, ENCODER / math.sqrt(12))),
    ],
)
def test_noise_is_white_and_as_large_as_stated(motion, shown, true, scale, std):
    noise = motion[shown] - scale * motion[true]
    moving = noise[:, MOVING]
    np.testing.assert_allclose(moving.std(axis=0), std, rtol=0.06)
    assert abs(moving.mean(axis=0)).max() < 4 * std / math.sqrt(3000)
    for j in range(moving.shape[1]):
        assert abs(np.corrcoef(moving[1:, j], moving[:-1, j])[0, 1]) < 4 / math.sqrt(3000)
    assert abs(np.corrcoef(moving.T)[0, 1]) < 4 / math.sqrt(3000)


def test_encoders_have_a_resolution_and_velocities_have_none(motion):
    steps = motion["actual_q"] / ENCODER
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert len(np.unique(motion["actual_qd"][:, 1])) == 3000


def test_torque_and_targets_follow_from_the_joint(motion):
    for j, joint in enumerate(build_joints("ur3e")):
        p = joint.values
        np.testing.assert_allclose(
            motion["actual_current_as_torque"][:, j], N * p["k_t"] * motion["actual_current"][:, j], rtol=1e-12
        )
        moment = (p["J_q"] + N**2 * p["J_m"]) * motion["target_qdd"][:, j]
        np.testing.assert_allclose(motion["target_moment"][:, j], moment, rtol=1e-12)
        np.testing.assert_allclose(motion["target_current"][:, j], moment / (N * p["k_t"]), rtol=1e-12)
    np.testing.assert_array_equal(motion["joint_control_output"], motion["true_current"])
    assert abs(motion["actual_joint_voltage"] - 48.0).max() < 1.0
    np.testing.assert_array_equal(motion["robot_mode"], 7)
    np.testing.assert_array_equal(motion["joint_mode"], 253)
    np.testing.assert_array_equal(motion["safety_mode"], 1)
    np.testing.assert_array_equal(motion["robot_status_bits"], 0b11)
    np.testing.assert_array_equal(motion["safety_status_bits"], 0b1)
    np.testing.assert_array_equal(motion["speed_scaling"][300:], 1.0)


@pytest.mark.parametrize("j", MOVING)
def test_a_fit_of_the_recorded_joint_finds_the_truth(motion, j):
    late = slice(500, None)
    channels = {
        "link_position": motion["actual_q"][late, j],
        "motor_velocity": N * motion["actual_qd"][late, j],
        "current": motion["actual_current"][late, j],
    }
    truth = build_joints("ur3e")[j].values
    model = HarmonicDrive(actuation="current")
    estimate = fit(model, Recording(motion["timestamp"][late], channels), ParameterSettings({"k_t": truth["k_t"]}))
    assert estimate.converged, estimate.message
    found = [p for p in estimate.parameters if p.name in estimate.free]
    assert {p.name for p in found} == {"J_m", "c_m", "tau_fm", "c_1", "k_1", "k_2", "J_q", "c_q", "tau_fq"}
    assert all(p.verdict is Verdict.ESTIMATED for p in found)
    z = {p.name: (p.value - truth[p.name]) / p.std_dev for p in found}
    assert max(map(abs, z.values())) < 4.0, z
    for p in found:
        assert p.std_dev < 0.05 * truth[p.name]
        assert abs(model.parameter(p.name).nominal / truth[p.name] - 1) > 0.005  # the start value was not the truth


def test_a_protective_stop_brakes_smoothly_and_holds_and_unlock_goes_on():
    controller = built()
    before = run(controller, 1000, truth=True)
    assert controller.protective_stop(True)
    assert not controller.protective_stop(True)
    held = run(controller, 500, truth=True)
    stop = round(STOP_S / TICK_S) + 1
    np.testing.assert_array_equal(held["target_qd"][stop:], 0.0)
    np.testing.assert_array_equal(held["target_qdd"][stop + 1 :], 0.0)
    np.testing.assert_array_equal(held["true_motor_velocity"][300:], 0.0)
    np.testing.assert_array_equal(held["true_link_position"][300:], np.tile(held["true_link_position"][-1], (200, 1)))
    assert abs(held["actual_q"][-1] - held["target_q"][-1]).max() < 0.03
    np.testing.assert_array_equal(held["safety_mode"], 3)
    np.testing.assert_array_equal(held["safety_status_bits"], 0b100_0000_0100)
    np.testing.assert_array_equal(held["robot_mode"], 7)
    np.testing.assert_array_equal(held["robot_status_bits"], 0b01)
    np.testing.assert_array_equal(held["speed_scaling"][stop:], 0.0)
    assert controller.protective_stop(False)
    after = run(controller, 1000, truth=True)
    assert after["safety_mode"][0] == 1
    assert abs(after["true_link_velocity"][300:, MOVING]).max() > 0.3
    whole = np.concatenate([r["target_q"] for r in (before, held, after)])
    assert abs(np.diff(whole, axis=0)).max() < 1.05 * abs(before["target_qd"]).max() * TICK_S
    currents = [abs(r["true_current"]).max() for r in (before, held, after)]
    assert max(currents[1:]) < 1.5 * currents[0]


@pytest.mark.long
def test_power_off_holds_the_joints_with_the_brakes_and_power_on_goes_on():
    controller = built()
    before = run(controller, 1000, truth=True)
    assert controller.power(False)
    assert not controller.power(False)
    off = run(controller, 200, truth=True)
    for name in ("actual_qd", "actual_current", "actual_current_as_torque", "target_moment", "actual_joint_voltage"):
        np.testing.assert_array_equal(off[name], 0.0, err_msg=name)
    for name in ("actual_q", "motor_position"):
        np.testing.assert_array_equal(off[name], np.tile(off[name][0], (200, 1)), err_msg=name)
    np.testing.assert_array_equal(off["motor_velocity"], 0.0)
    np.testing.assert_array_equal(off["joint_control_output"], 0.0)
    np.testing.assert_array_equal(off["target_qd"], 0.0)
    np.testing.assert_array_equal(off["robot_mode"], 3)
    np.testing.assert_array_equal(off["joint_mode"], 239)
    np.testing.assert_array_equal(off["robot_status_bits"], 0)
    np.testing.assert_array_equal(np.diff(off["timestamp"]).round(9), 0.002)
    assert controller.power(True)
    on = run(controller, 1500, truth=True)
    assert (on["robot_mode"][0], on["joint_mode"][0, 0]) == (7, 253)
    assert abs(on["target_q"][0] - off["actual_q"][-1]).max() < 1e-5
    assert abs(np.diff(on["target_q"], axis=0)).max() < 1.05 * abs(before["target_qd"]).max() * TICK_S
    assert abs(on["true_current"]).max() < 1.5 * abs(before["true_current"]).max()
    error = on["actual_q"][500:] - on["target_q"][500:]
    assert error.std(axis=0).max() < 0.02
    assert abs(on["true_link_velocity"][500:, MOVING]).max() > 0.3
    # Back on its course, as if the time without power and the two starts had not been.
    path = 1000 * TICK_S - START_S / 2 + np.arange(1500) * TICK_S - START_S / 2
    expected = HOME[0] + position_reference(0.3, seed=1).value(path)
    np.testing.assert_allclose(on["target_q"][1000:, 0], expected[1000:], atol=1e-6)


def test_a_stop_lasts_through_power_off_and_on():
    controller = built()
    run(controller, 500)
    controller.protective_stop(True)
    controller.power(False)
    run(controller, 10)
    controller.power(True)
    on = run(controller, 600, truth=True)
    np.testing.assert_array_equal(on["safety_mode"], 3)
    np.testing.assert_array_equal(on["true_link_velocity"][-1], 0.0)


def test_a_joint_at_rest_cools_and_one_that_moves_warms_up():
    controller = built(moving=(5,), amplitude=0.4)
    start = run(controller, 1)["joint_temperatures"][0]
    np.testing.assert_allclose(start, np.linspace(25.0, 30.0, 6))
    run(controller, 500)
    middle = run(controller, 1)["joint_temperatures"][0]
    np.testing.assert_allclose(middle[:5], 25.0 + (start[:5] - 25.0) * math.exp(-501 * 0.002 / 2000.0), rtol=1e-6)
    joint = build_joints("ur3e")[5]
    assert middle[5] > start[5]
    # Bounded by what ten watts would do.
    assert middle[5] - start[5] < 10.0 * 1.002 / (800.0 * joint.size)


def test_fields_depend_on_the_version_and_on_what_is_left_out():
    controller = built(version=(5, 13, 0, 0), without=("actual_q", "output_double_register_24"))
    assert controller.type_of("timestamp") == "DOUBLE"
    assert controller.type_of("joint_mode") == "VECTOR6INT32"
    assert controller.type_of("output_int_register_47") == "INT32"
    for name in ("actual_q", "output_double_register_24", "actual_current_as_torque", "no_such", "", "timestamp "):
        assert controller.type_of(name) is None, name
    assert built(version=(5, 23, 0, 0)).type_of("actual_current_as_torque") == "VECTOR6D"
    assert controller.input_type_of("input_double_register_24") == "DOUBLE"
    for name in ("output_double_register_24", "timestamp", "input_double_register_48"):
        assert controller.input_type_of(name) is None


def test_a_seed_repeats_the_noise_and_another_changes_only_that():
    a, b, c = (run(built(seed=s), 30) for s in (1, 1, 2))
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)
    assert not np.array_equal(a["actual_current"], c["actual_current"])
    np.testing.assert_array_equal(a["target_q"], c["target_q"])


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_joint_has_values_of_its_own(robot):
    joints = build_joints(robot)
    assert joints == build_joints(robot)
    assert len({tuple(j.values.items()) for j in joints}) == 6
    stiffness = [j.values["k_1"] for j in joints]
    assert max(stiffness[3:]) < min(stiffness[:3])


@pytest.mark.long
def test_all_six_joints_of_the_largest_robot_stay_under_control():
    controller = built("ur10e", range(6), amplitude=0.3)
    moved = run(controller, 1500)
    assert (moved["actual_q"] - moved["target_q"])[500:].std(axis=0).max() < 0.02


def test_an_unknown_robot_is_refused():
    with pytest.raises(JointIdError, match="unknown robot 'ur7': choose one of ur3e"):
        build_joints("ur7")
