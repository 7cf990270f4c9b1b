"""The action `identify` on an emulated robot: go, record, fit, report; and what cannot be done."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
import yaml
from action_msgs.msg import GoalStatus
from identify_bench import ELBOW, SECONDS, WRIST, Bench, aborted, motion, travel
from std_srvs.srv import Trigger

from joint_id_core.design.files import write
from joint_id_core.emulator.robots import HOME
from joint_id_msgs.action import Identify
from joint_id_msgs.msg import JointEstimate, ParameterEstimate


@pytest.fixture
def bench(start, probe, robot, tmp_path):
    return Bench(start, probe, robot, tmp_path)


@pytest.fixture
def known_bench(start, probe, robot, tmp_path):
    """With the limits, gear ratios and torque constants of a UR3e, over which those of the goal go."""
    return Bench(start, probe, robot, tmp_path, robot="ur3e")


def seconds(stamp):
    return stamp.sec + stamp.nanosec * 1e-9


def test_a_joint_is_identified_by_a_motion_made_for_it_and_another_goal_is_rejected(bench):
    handle = bench.send()
    assert handle.accepted
    bench.phase(Identify.Feedback.WAITING_FOR_GO)
    assert not bench.send().accepted  # one at a time
    bench.probe.until(lambda: bench.probe.told("identify", "one identification at a time"), "the reason")
    begin = bench.links[-1].position[2]
    bench.probe.spin(2.0)
    assert not bench.orders
    assert abs(bench.links[-1].position[2] - begin) < 1e-3  # nothing moves before the go
    bench.go()
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    (joint,) = result.joints
    assert (joint.joint, joint.model, joint.status) == (ELBOW, "harmonic_drive", JointEstimate.CONVERGED), joint.message
    rows = {p.name: p for p in joint.parameters}
    shown = [p for p in rows.values() if p.verdict == ParameterEstimate.ESTIMATED]
    assert {"k_1", "J_q", "J_m", "c_m", "tau_fm"} <= {p.name for p in shown}
    for p in shown:
        assert abs(p.value - bench.known[p.name]) < 4.5 * p.std_dev, f"{p.name} {p.value} +- {p.std_dev}"
    assert travel(result.bag) > 0.05
    # The part that was fitted is the trajectory; at its ends the robot of a loaded computer may not have sent samples.
    assert SECONDS - 0.5 < seconds(joint.window_end) - seconds(joint.window_start) < SECONDS + 0.05
    page = Path(result.page).read_text()
    assert "harmonic_drive" in page and "joint-id report" in page
    phases = [f.phase for f in bench.feedback]
    assert phases == sorted(phases) and {2, 3, 4} <= set(phases)
    assert not bench.probe.call(Trigger, "identify/go", Trigger.Request()).success


@pytest.mark.long
def test_a_motion_is_planned_from_where_the_joint_is_and_its_promise_holds(known_bench):
    bench = known_bench
    wrong = bench.folder / "wrong.csv"
    write(motion(peak=1.5), wrong)
    aborted(bench, "wrong.csv breaks a limit: elbow_joint: position", trajectory=str(wrong))
    handle = bench.send(trajectory="", joints=[ELBOW], model="motor_side", duration=6.0)
    bench.go()
    told = next(f for f in bench.feedback if f.expected)
    assert told.phase == Identify.Feedback.WAITING_FOR_GO and "what the arm could hit" in told.message
    (promise,) = told.expected
    promised = {p.name: p for p in promise.parameters if p.verdict == ParameterEstimate.ESTIMATED}
    assert promise.joint == ELBOW and {"J_m", "tau_fm"} <= set(promised)
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    (joint,) = result.joints
    assert joint.status == JointEstimate.CONVERGED, joint.message
    rows = {p.name: p for p in joint.parameters}
    for name in promised:
        assert abs(rows[name].value - bench.known.get(name, 0.0)) < 5.0 * rows[name].std_dev, name
    ratios = [rows[name].std_dev / p.std_dev for name, p in promised.items()]  # of one joint, unlike what was believed
    assert 1 / 3 < np.exp(np.mean(np.log(ratios))) < 3.0, dict(zip(promised, ratios, strict=True))
    sent = bench.orders[0]
    assert sent.points[0].positions[0] == pytest.approx(HOME[2], abs=1e-3)


@pytest.mark.long
def test_what_cannot_be_done_is_a_result_with_a_reason_and_nothing_moves(bench):
    strange, wrong = bench.folder / "strange.csv", bench.folder / "wrong.csv"
    write(motion(joint="elbow"), strange)
    wrong.write_text("time,torque\n0,1\n")
    aborted(bench, "cannot be read (No such file or directory)", trajectory=str(bench.folder / "none.csv"))
    aborted(bench, "no trajectory: its first row must name time", trajectory=str(wrong))
    aborted(bench, "the motion is for elbow, but link_states has shoulder_pan_joint", trajectory=str(strange))
    aborted(bench, "does not move wrist_1_joint: it moves elbow_joint", joints=["wrist_1_joint"])
    aborted(bench, "option model = 'harmonicdrive' (did you mean harmonic_drive?)", model="harmonicdrive")
    aborted(bench, "--set k_t", set=["k_t"])
    assert not bench.orders and not list(bench.results.glob("*.mcap"))
    # A trajectory that the robot refuses: the node that moves it says why.
    write(motion(peak=1.5), strange)
    handle = bench.send(trajectory=str(strange))
    bench.go()
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert "the joints do not move: the diagnostics of the node that reads it say why" in result.message
    refused = "the robot cannot follow the trajectory: elbow_joint"
    bench.probe.until(lambda: bench.probe.told("emulated_motion", refused), "the reason of the node that moves it")
    assert travel(result.bag) < 1e-3
    assert bench.identify.running and bench.mover.running


@pytest.mark.long
def test_joints_are_identified_one_after_the_other_by_one_plan_and_one_go(known_bench):
    bench, joints = known_bench, [ELBOW, WRIST]
    aborted(bench, "name the joints that a motion is planned for", trajectory="", model="motor_side")
    aborted(bench, "name each joint once", trajectory="", joints=[ELBOW, ELBOW], model="motor_side")
    handle = bench.send(trajectory="", joints=joints, model="motor_side", set=[], duration=5.0)
    bench.go()
    told = next(f for f in bench.feedback if f.expected)
    assert [promise.joint for promise in told.expected] == joints
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert len(bench.orders) == 1 and list(bench.orders[0].joint_names) == joints
    assert [joint.joint for joint in result.joints] == joints
    truth = yaml.safe_load(bench.truth.read_text())
    spans = []
    for promise, joint in zip(told.expected, result.joints, strict=True):
        assert joint.status == JointEstimate.CONVERGED, joint.message
        rows, true = {p.name: p for p in joint.parameters}, truth[joint.joint]
        gain = rows["k_t"].value / true["k_t"]  # of this robot it is not that of the file
        for p in promise.parameters:
            if p.verdict == ParameterEstimate.ESTIMATED:
                off = abs(rows[p.name].value - gain * true.get(p.name, 0.0))
                assert off < 5.0 * rows[p.name].std_dev, f"{joint.joint} {p.name}"
        spans.append((seconds(joint.window_start), seconds(joint.window_end)))
    (begin, middle), (then, end) = spans
    # Each was fitted where it moved.
    assert middle - begin == pytest.approx(5.0, abs=0.1) and end - then == pytest.approx(5.0, abs=0.1)
    assert then == pytest.approx(middle, abs=0.1)


@pytest.mark.long
def test_a_motion_that_the_user_starts_at_the_robot_is_recognised(bench):
    """Without the node that moves the robot, as on a real one."""
    bench.mover.signal(signal.SIGINT)
    assert bench.mover.wait() == 0
    handle = bench.send()
    bench.phase(Identify.Feedback.WAITING_FOR_GO)
    bench.probe.spin(2.0)
    bench.machine.tell(f"follow {bench.file}")
    bench.phase(Identify.Feedback.MOVING)
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert result.joints[0].status == JointEstimate.CONVERGED and not bench.orders
