"""The action `identify` on an emulated robot: go, record, fit, report; and what happens when something is wrong."""

from __future__ import annotations

import resource
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from joint_id_core import formats
from joint_id_core.design.files import write
from joint_id_core.design.fourier import FourierMotion
from joint_id_core.emulator.robots import HOME
from joint_id_core.rtde.fields import JOINT_NAMES
from joint_id_msgs.action import Identify
from joint_id_msgs.msg import JointEstimate, ParameterEstimate
from joint_id_ros.trajectories import QOS

ELBOW, WRIST = "elbow_joint", "wrist_1_joint"
SECONDS = 6.0


def motion(joint=ELBOW, tones=(0.5, 1.1, 2.3, 3.7), peak=0.03):
    """A motion of one joint of the emulated robot, from its home and back."""
    waves = np.full((1, len(tones)), peak) / np.array(tones) ** 0.5
    home = HOME[JOINT_NAMES.index(ELBOW)]
    return FourierMotion((joint,), (home,), waves, waves, tones, SECONDS, 1.0).sampled(125.0)


class Bench:
    """An emulated robot, the nodes around it, and a client of the action."""

    def __init__(self, start, probe, robot_of, folder, **parameters):
        self.start, self.probe, self.folder = start, probe, folder
        self.truth, self.file = folder / "truth.yaml", folder / "motion.csv"
        write(motion(), self.file)
        self.results = folder / "results"
        self.results.mkdir()
        self.machine = robot_of("--moving", "none", "--socket", str(folder / "socket"), "--truth", str(self.truth))
        self.links = probe.collect(JointState, "link_states")
        self.orders = probe.collect(JointTrajectory, "joint_trajectory", QOS)
        self.driver = start("driver", robot_ip="127.0.0.1", port=self.machine.port, stall_s=20.0)
        self.mover = start("emulated_motion", socket=folder / "socket")
        self.identify = start("identify", directory=self.results, wait_s=120.0, silent_s=8.0, **parameters)
        self.client = ActionClient(probe, Identify, "identify")
        self.feedback = []
        probe.until(lambda: len(self.links) > 100, "samples")
        probe.until(self.client.server_is_ready, "the action")
        probe.until(lambda: probe.count_subscribers("joint_trajectory") >= 2, "the node that moves the robot")
        probe.until(lambda: probe.told("identify", "waiting for a goal"), "the node")

    def send(self, **goal):
        """Send a goal; its handle, accepted or not."""
        self.feedback.clear()
        gains = [f"{n}={self.known[n]}" for n in ("k_t", "N")]
        goal = Identify.Goal(**{"trajectory": str(self.file), "model": "harmonic_drive", "set": gains} | goal)
        sent = self.client.send_goal_async(goal, feedback_callback=lambda m: self.feedback.append(m.feedback))
        self.probe.until(sent.done, "an answer to the goal")
        return sent.result()

    @property
    def known(self):
        return yaml.safe_load(self.truth.read_text())[ELBOW]

    def phase(self, phase):
        self.probe.until(lambda: any(f.phase == phase for f in self.feedback), f"phase {phase}")

    def go(self):
        self.phase(Identify.Feedback.WAITING_FOR_GO)
        answer = self.probe.call(Trigger, "identify/go", Trigger.Request())
        assert answer.success, answer.message

    def moves(self):
        """Wait until the joint is well on its way along the trajectory."""
        self.phase(Identify.Feedback.MOVING)
        begin = self.links[-1].position[2]
        self.probe.until(lambda: abs(self.links[-1].position[2] - begin) > 0.02, "a motion")

    def result(self, handle):
        waited = handle.get_result_async()
        self.probe.until(waited.done, "the result")
        return waited.result().status, waited.result().result


@pytest.fixture
def bench(start, probe, robot, tmp_path):
    return Bench(start, probe, robot, tmp_path)


@pytest.fixture
def known_bench(start, probe, robot, tmp_path):
    """With the limits, gear ratios and torque constants of a UR3e, over which those of the goal go."""
    return Bench(start, probe, robot, tmp_path, robot="ur3e")


def positions_in(bag):
    """Measured positions of the elbow in a bag."""
    q = formats.read(Path(bag), ELBOW)["link_position"]
    return q[np.isfinite(q)]


def travel(bag):
    """How far the elbow moved in a bag, in rad."""
    return float(np.ptp(positions_in(bag)))


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
    # The part that was fitted is the trajectory.
    assert seconds(joint.window_end) - seconds(joint.window_start) == pytest.approx(SECONDS, abs=0.05)
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


def test_a_cancel_stops_the_motion_and_leaves_a_readable_bag(bench):
    for _ in range(2):  # the node lives on
        bench.orders.clear()
        handle = bench.send()
        bench.go()
        bench.moves()
        assert [bool(order.points) for order in bench.orders] == [True]
        before = len(bench.links)
        cancel = handle.cancel_goal_async()
        bench.probe.until(lambda: len(bench.orders) > 1, "the stop")
        bench.probe.until(cancel.done, "an answer to the cancel")
        assert not bench.orders[1].points
        status, result = bench.result(handle)
        assert (status, result.message, result.joints) == (GoalStatus.STATUS_CANCELED, "cancelled", [])
        bench.machine.wait_for("stop: the joints come to rest", len(bench.machine.lines) - 1)
        positions = [m.position[2] for m in bench.links[before:]]
        rest = positions[-1]
        bench.probe.spin(1.0)
        assert abs(bench.links[-1].position[2] - rest) < 1e-3
        assert (Path(result.bag) / "metadata.yaml").exists()
        recorded = positions_in(result.bag)
        assert np.ptp(recorded) > 0.015
        assert recorded[-1] == pytest.approx(rest, abs=2e-3), "the braking is in the recording"
    # Before the go, and while nothing moves, a cancel ends the goal without a recording.
    handle = bench.send()
    bench.phase(Identify.Feedback.WAITING_FOR_GO)
    handle.cancel_goal_async()
    status, result = bench.result(handle)
    assert (status, result.bag, result.page) == (GoalStatus.STATUS_CANCELED, "", "")


def aborted(bench, says, **goal):
    """A goal that is accepted, and fails with a reason."""
    handle = bench.send(**goal)
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert says in result.message, result.message
    return result


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
    assert bench.probe.told("emulated_motion", "the robot cannot follow the trajectory: elbow_joint")
    assert travel(result.bag) < 1e-3
    assert bench.identify.running and bench.mover.running


def test_a_full_disk_and_a_robot_that_is_killed_end_the_goal_and_lose_nothing(bench):
    unlimited = resource.prlimit(bench.identify.pid, resource.RLIMIT_FSIZE, (1_000_000, resource.RLIM_INFINITY))
    handle = bench.send()
    bench.go()
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert "recording ended (File too large)" in result.message and not bench.orders[-1].points
    assert len(positions_in(result.bag)) > 100
    resource.prlimit(bench.identify.pid, resource.RLIMIT_FSIZE, unlimited)
    # The next goal is as good as the first one, until the robot is killed.
    handle = bench.send()
    bench.go()
    bench.moves()
    bench.machine.process.kill()
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert "no samples on link_states for 8 s: is the driver running" in result.message
    assert not bench.orders[-1].points  # a stop was sent, whoever hears it
    assert travel(result.bag) > 0.015
    aborted(bench, "no positions on link_states: is the driver running?")
    assert bench.identify.running and bench.mover.running
    bench.mover.signal(signal.SIGTERM)
    assert bench.mover.wait() == 0


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


def test_a_node_that_is_stopped_in_motion_stops_the_robot_and_closes_the_bag(bench):
    handle = bench.send()
    bench.go()
    bench.moves()
    bench.identify.signal(signal.SIGTERM)
    bench.probe.until(lambda: not bench.orders[-1].points, "the stop")
    assert bench.identify.wait() == 0
    (bag,) = bench.results.glob("identify_*/")
    assert (bag / "metadata.yaml").exists() and travel(bag) > 0.015
    assert handle.accepted
