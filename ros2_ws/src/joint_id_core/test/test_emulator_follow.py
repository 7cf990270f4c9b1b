"""The emulated robot follows a trajectory, from where it is, stops on demand, and refuses what it cannot do."""

from dataclasses import replace

import numpy as np
import pytest

from joint_id_core.design.files import write
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.design.limit_files import published
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.emulator.command_socket import give
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.process import EmulatorProcess
from joint_id_core.emulator.reference import START_S, STOP_S, TICK_S
from joint_id_core.emulator.robots import HOME, build_joints
from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import JOINT_NAMES

PEAK = 0.05  # rad, of each of four waves
TARGETS = ("target_q", "target_qd", "target_qdd")


def motion(names=JOINT_NAMES[2:4], home=(1.2, -1.0), peak=PEAK, tones=(0.5, 1.0), rate=125.0):
    """A trajectory of 4 s that starts elsewhere than the robot."""
    size = np.full((len(names), 2), peak)
    return FourierMotion(tuple(names), home, size, size, tones, 4.0, 1.0).sampled(rate)


def built(moving=(0, 3), **changes):
    limits = published("ur3e")
    return Controller(build_joints("ur3e"), moving, 0.3, (5, 23, 0, 0), limits=limits, **changes)


def run(controller, seconds):
    """Reported fields at each tick, shape (ticks, 6) or (ticks,)."""
    names = (*TARGETS, "target_moment", "actual_q", "speed_scaling", "timestamp")
    rows = []
    for _ in range(round(seconds / TICK_S)):
        controller.tick()
        controller.report()
        rows.append([np.array(controller.values[name], dtype=float) for name in names])
        controller.advance()
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def after(first, second):
    return {name: np.concatenate([first[name], second[name]]) for name in first}


def assert_smooth(found):
    """Targets are derivatives of each other: no jump of position or velocity."""
    for name, rate, share in (("target_q", "target_qd", 0.02), ("target_qd", "target_qdd", 0.1)):
        middle = (found[name][2:] - found[name][:-2]) / (2 * TICK_S)
        np.testing.assert_allclose(middle, found[rate][1:-1], atol=share * abs(found[rate]).max())


def test_the_joints_go_to_the_start_slowly_and_then_follow_exactly():
    controller, trajectory = built(), motion()
    before = run(controller, 1.0)
    told = controller.follow(trajectory)
    found = run(controller, 9.0)
    assert_smooth(after(before, found))
    still = np.nonzero(found["speed_scaling"] == 0.0)[0]
    assert 0 < still[0] <= round(STOP_S / TICK_S) + 1
    away = found["target_q"][-1]  # the trajectory ends where it began
    np.testing.assert_allclose(away[2:4], trajectory.position[-1], atol=1e-12)
    np.testing.assert_array_equal(found["target_q"][still[0] :, [0, 1, 4, 5]], [away[[0, 1, 4, 5]]] * (4500 - still[0]))
    moving = np.nonzero(abs(found["target_qd"]).max(axis=1) > 1e-6)[0]
    begin = moving[-1] + 2 - round(trajectory.duration / TICK_S)
    assert abs(begin * TICK_S - told) < STOP_S + START_S
    way = abs(found["target_qd"][still[0] : begin - 10]).max()
    assert way == pytest.approx(0.3, rel=0.01)
    along = np.arange(0, len(found["target_q"]) - begin) * TICK_S
    best = min(
        abs(found["target_q"][begin:, 2:4] - trajectory.at(along + shift).position).max()
        for shift in np.linspace(-TICK_S, TICK_S, 201)  # the path need not meet the ticks
    )
    assert best < 1e-5 < 0.1 < np.ptp(found["target_q"][begin:, 2])
    np.testing.assert_allclose(found["actual_q"][begin:], found["target_q"][begin:], atol=0.03)


def test_the_quintic_joins_the_samples():
    """At 25 samples a second the targets are as those of the exact motion, which a straight line would miss by far."""
    trajectory = motion(rate=25.0)
    exact = FourierMotion(
        JOINT_NAMES[2:4], (1.2, -1.0), np.full((2, 2), PEAK), np.full((2, 2), PEAK), [0.5, 1.0], 4.0, 1.0
    )
    time = np.arange(0.0, 4.0, TICK_S)
    np.testing.assert_allclose(trajectory.at(time).position, exact.at(time).position, atol=1e-6)
    straight = np.interp(time, trajectory.time, trajectory.position[:, 0])
    assert abs(straight - exact.at(time).position[:, 0]).max() > 1e-4


@pytest.mark.long
def test_target_moment_is_that_of_the_trajectory():
    controller = built(moving=())
    controller.follow(motion())
    found = run(controller, 8.0)
    inertia = [j.values["J_q"] + j.values["N"] ** 2 * j.values["J_m"] for j in build_joints("ur3e")]
    np.testing.assert_allclose(found["target_moment"], inertia * found["target_qdd"], rtol=1e-12)
    assert abs(found["target_moment"]).max() > 1.0


def test_a_stop_is_soft_and_lasts():
    controller = built()
    moved = run(controller, controller.follow(motion()) + 2.0)
    assert abs(moved["target_qd"][-1]).max() > 0.01
    controller.arm.reference.stop()
    held = run(controller, 2.0)
    assert_smooth(after(moved, held))
    ticks = round(STOP_S / TICK_S) + 1
    np.testing.assert_array_equal(held["target_qd"][ticks:], 0.0)
    np.testing.assert_array_equal(held["target_q"][ticks:], [held["target_q"][-1]] * (1000 - ticks))
    controller.follow(motion())  # and it goes on from there
    assert_smooth(after(held, run(controller, 3.0)))


@pytest.mark.long
def test_a_new_trajectory_takes_the_place_of_the_old_one_smoothly():
    controller = built()
    first = run(controller, controller.follow(motion()) + 2.0)
    controller.follow(motion(home=(1.0, -1.2)))
    second = run(controller, 8.0)
    assert_smooth(after(first, second))
    np.testing.assert_allclose(second["target_q"][-1, 2:4], (1.0, -1.2), atol=1e-12)


def test_power_off_ends_a_trajectory_and_a_protective_stop_holds_it():
    controller = built()
    run(controller, controller.follow(motion()) + 1.0)
    controller.protective_stop(True)
    run(controller, 1.0)
    controller.protective_stop(False)
    rest = run(controller, 6.0)
    np.testing.assert_allclose(rest["target_q"][-1, 2:4], motion().position[-1], atol=1e-12)
    controller.follow(motion())
    run(controller, 3.0)
    controller.power(False)
    with pytest.raises(JointIdError, match="the robot is off: give power-on first"):
        controller.follow(motion())
    controller.power(True)
    np.testing.assert_array_equal(np.ptp(run(controller, 2.0)["target_q"], axis=0), 0.0)


def changed(trajectory, factor):
    """The same motion, larger."""
    home = trajectory.position[0]
    parts = (
        factor * (trajectory.position - home) + home,
        factor * trajectory.velocity,
        factor * trajectory.acceleration,
    )
    return Trajectory(trajectory.names, trajectory.time, *parts)


@pytest.mark.parametrize(
    ("trajectory", "says"),
    [
        (
            motion(names=("elbow_jiont", "wrist_1_joint")),
            r"elbow_jiont', which this robot does not have \(did you mean elb",
        ),
        (motion(home=(3.1, -1.0)), "elbow_joint: position 3.* limits -3.14159 to 3.14159 rad"),
        (changed(motion(), 12.0), "elbow_joint: velocity .* limit 3.14159 rad/s"),
        (motion(peak=0.03, tones=(5.0, 6.0), rate=500.0), "wrist_1_joint would need .* its drive gives at most"),
    ],
    ids=["name", "position", "velocity", "torque"],
)
def test_what_the_robot_cannot_follow_is_refused_and_nothing_changes(trajectory, says):
    one, other = built(), built()
    for controller in (one, other):
        run(controller, 0.5)
    with pytest.raises(JointIdError, match=says):
        one.follow(trajectory)
    a, b = run(one, 0.5), run(other, 0.5)
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


@pytest.fixture
def running(tmp_path):
    with EmulatorProcess("--moving", "none", "--socket", str(tmp_path / "robot")) as emulator:
        yield emulator


def test_commands_come_from_standard_input_and_from_the_socket(running, tmp_path):
    file, socket = tmp_path / "a motion.csv", tmp_path / "robot"
    write(motion(), file)
    assert "then 4 s of elbow_joint, wrist_1_joint" in running.tell(f"follow {file}")
    assert give(socket, "stop").startswith("stop: the joints come to rest")
    assert give(socket, f"follow {file}").startswith("follow: to the start within")
    running.wait_for("follow:", 3)  # it is told there, too
    for command, says in (
        ("follow", "command follow needs an argument: write follow FILE"),
        (f"follow {tmp_path / 'none.csv'}", "cannot be read"),
        ("explode", "unknown command 'explode'"),
    ):
        with pytest.raises(JointIdError, match=says):
            give(socket, command)
        running.wait_for_error(says)
    with pytest.raises(JointIdError, match=r"exit code 2: .*another emulator listens at"):
        EmulatorProcess("--socket", str(socket))


def test_a_socket_goes_with_its_emulator_and_one_that_is_left_is_replaced(running, tmp_path):
    socket = tmp_path / "robot"
    running.process.kill()
    running.process.wait()
    assert socket.exists()
    with pytest.raises(JointIdError, match=r"no answer of an emulator at .*start it with --socket"):
        give(socket, "stop")
    with EmulatorProcess("--moving", "none", "--socket", str(socket)) as again:
        assert give(socket, "stop")
        again.tell("quit")
        again.process.wait()
    assert not socket.exists()
    socket.write_text("mine")
    with pytest.raises(JointIdError, match="is no socket: choose another name"):
        EmulatorProcess("--socket", str(socket))
    assert socket.read_text() == "mine"


def test_limits_of_an_arm_are_those_of_its_joints_by_their_own_names():
    joints = tuple(replace(j, name=f"axis_{k}") for k, j in enumerate(build_joints("ur3e")))
    limits = replace(published("ur3e"), names=tuple(j.name for j in joints))
    controller = Controller(joints, (), 0.3, (5, 23, 0, 0), limits=limits)
    controller.follow(motion(names=("axis_2", "axis_3")))
    with pytest.raises(JointIdError, match="axis_2: velocity"):
        controller.follow(changed(motion(names=("axis_2", "axis_3")), 12.0))
    assert HOME[2] == pytest.approx(controller.values["target_q"][2] or HOME[2])
