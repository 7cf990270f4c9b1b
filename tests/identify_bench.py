"""An emulated robot with the nodes of the action `identify` around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
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


def positions_in(bag):
    """Measured positions of the elbow in a bag."""
    q = formats.read(Path(bag), ELBOW)["link_position"]
    return q[np.isfinite(q)]


def travel(bag):
    """How far the elbow moved in a bag, in rad."""
    return float(np.ptp(positions_in(bag)))


def aborted(bench, says, **goal):
    """A goal that is accepted, and fails with a reason."""
    handle = bench.send(**goal)
    status, result = bench.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert says in result.message, result.message
    return result
