"""Node `arm_identifier`: learns an arm, finds its payload, rests, resumes, and tells what is wrong with its input."""

from __future__ import annotations

import signal

import numpy as np
import pytest
from core_arm import moving_arm
from robot_messages import NANO, stamp
from std_msgs.msg import String
from std_srvs.srv import Trigger

from joint_id_core.stored.file_lock import FileLock
from joint_id_msgs.msg import ArmPayload, JointEstimate, JointParams, JointSamples, ParameterEstimate
from joint_id_ros.qos import LATEST, STREAM_OUT

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

JOINTS, URDF, CARRYING = moving_arm.JOINTS, moving_arm.URDF, moving_arm.CARRYING
EVERY = 2  # of the samples of the arm: 250 a second
RATE = moving_arm.RATE / EVERY
LEARN, CARRY = 26.0, 8.0  # s
CHUNK = 50


@pytest.fixture(scope="module")
def motions():
    """Positions and torques without and with the payload, each of shape (T, 6)."""
    arms = [moving_arm.rigid(LEARN + CARRY, 0, urdf) for urdf in (URDF, CARRYING)]
    position = np.column_stack([arms[0][n]["link_position"] for n in JOINTS])[::EVERY]
    torques = [np.column_stack([arm[n]["torque"] for n in JOINTS]) for arm in arms]
    held = [torque.reshape(len(position), EVERY, len(JOINTS)).mean(axis=1) for torque in torques]  # over a sample
    return position, *held


class Arm:
    """Publishes samples of an arm, and looks at what a node makes of them."""

    def __init__(self, start, probe, motions, names=JOINTS, **parameters) -> None:
        self.probe, self.start, self.motions, self.names = probe, start, motions, names
        self.k, self.parameters = 0, parameters
        self.found = probe.collect(JointParams, "joint_params", LATEST)
        self.payloads = probe.collect(ArmPayload, "payload", LATEST)
        self.samples = probe.create_publisher(JointSamples, "joint_samples", STREAM_OUT)
        self.descriptions = probe.create_publisher(String, "robot_description", LATEST)
        self.begin()

    def begin(self) -> None:
        """Start a node."""
        self.node = self.start("arm_identifier", **self.parameters)
        self.probe.until(lambda: self.samples.get_subscription_count() >= 1, "the node")

    def send(self, seconds: float, loaded: bool = False, still: bool = False) -> None:
        """Publish so many seconds of samples."""
        position, empty, full = self.motions
        for count in range(round(seconds * RATE)):
            at = 0 if still else self.k % len(position)
            message = JointSamples(name=list(self.names), measured=JointSamples.LINK_POSITION | JointSamples.TORQUE)
            message.link_position = position[at][: len(self.names)].tolist()
            message.torque = (full if loaded else empty)[at][: len(self.names)].tolist()
            message.header.stamp = stamp(1000 * NANO + round(self.k * NANO / RATE))
            self.samples.publish(message)
            self.k += 1
            if count % CHUNK == CHUNK - 1:
                self.probe.spin(0.005)

    def newest(self, joint: str) -> JointEstimate | None:
        """The newest estimate of a joint."""
        return next((j for j in self.found[-1].joints if j.joint == joint), None) if self.found else None

    def until(self, status: int, joint: str = "lift") -> JointEstimate:
        """Wait until the newest estimate of a joint has a status; those of samples that end are taken back."""

        def newest() -> JointEstimate | None:
            return next((j for message in reversed(self.found) for j in message.joints if j.joint == joint), None)

        self.probe.until(lambda: (n := newest()) is not None and n.status == status, f"status {status}")
        found = newest()
        assert found is not None
        return found


def check(found: JointEstimate) -> None:
    """The parameters of a joint are right, within their intervals."""
    k, rows = JOINTS.index(found.joint), {p.name: p for p in found.parameters}
    for name, truth in (("c", moving_arm.VISCOUS[k]), ("tau_f", moving_arm.COULOMB[k])):
        row = rows[name]
        assert row.verdict == ParameterEstimate.ESTIMATED
        assert abs(row.value - truth) < 4.5 * row.std_dev < 0.1 * truth, (found.joint, name, row.value, row.std_dev)


def test_an_arm_is_learnt_its_payload_found_and_kept_over_a_restart(start, probe, motions, tmp_path):
    state = tmp_path / "arm.json"
    arm = Arm(start, probe, motions, state_file=str(state))
    arm.send(1.0)
    probe.until(lambda: probe.told("arm_identifier", "no description of the robot on robot_description yet"), "that")
    arm.descriptions.publish(String(data=URDF))
    probe.until(lambda: probe.told("arm_identifier", "learning"), "the description")
    arm.send(3.0)
    learning = arm.until(JointEstimate.TOO_SHORT)
    assert "of 20 s of motion" in learning.message
    probe.until(lambda: arm.payloads, "a payload")
    assert arm.payloads[-1].verdict == 0
    arm.send(LEARN - 4.0)
    for name in JOINTS:
        found = arm.until(JointEstimate.CONVERGED, name)
        check(found)
        assert found.model == "arm" and len(found.covariance) == len(found.free) ** 2
    probe.until(lambda: arm.payloads[-1].verdict == ParameterEstimate.ESTIMATED, "that there is none")
    assert not arm.payloads[-1].carries

    picked_ns = 1000 * NANO + round(arm.k * NANO / RATE)
    arm.send(CARRY, loaded=True)
    probe.until(lambda: arm.payloads[-1].carries and arm.payloads[-1].mass_std_dev < 0.05, "the payload")
    payload = arm.payloads[-1]
    assert abs(payload.mass - moving_arm.MASS) < max(4.0 * payload.mass_std_dev, 0.01)
    np.testing.assert_allclose(payload.centre, moving_arm.CENTRE, atol=0.01)
    assert payload.link == "plate" and payload.message.startswith("Changed: payload on plate")
    since_ns = payload.since.sec * NANO + payload.since.nanosec
    assert abs(since_ns - picked_ns) < 1.0 * NANO

    arm.send(3.0, still=True)
    found = arm.until(JointEstimate.NO_MOTION)
    assert found.parameters_status == JointEstimate.CONVERGED
    check(found)

    probe.until(state.exists, "the state file")
    answer = probe.call(Trigger, "/arm_identifier/save", Trigger.Request())
    assert answer.success and str(state) in answer.message
    arm.node.signal(signal.SIGKILL)
    arm.node.wait()
    arm.found.clear()
    arm.begin()
    again = arm.until(JointEstimate.TOO_SHORT)
    assert again.message.startswith("Restored from") and again.parameters_status == JointEstimate.CONVERGED
    for old, new in zip(found.parameters, again.parameters, strict=True):
        assert abs(new.value - old.value) <= old.std_dev and new.std_dev < 2.0 * old.std_dev
    check(again)
    arm.send(CARRY, loaded=True)
    arm.until(JointEstimate.CONVERGED)
    probe.until(lambda: arm.payloads[-1].carries, "the payload")
    assert abs(arm.payloads[-1].mass - moving_arm.MASS) < 0.1


@pytest.mark.long
def test_what_was_published_is_taken_back_while_no_samples_come(start, probe, motions, tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    arm = Arm(start, probe, motions, urdf=str(tmp_path / "arm.urdf"))
    arm.send(LEARN)
    arm.until(JointEstimate.CONVERGED)
    probe.until(lambda: arm.newest("lift") is None, "the end of the samples")
    probe.until(lambda: probe.told("arm_identifier", "no samples of all joints for 2 s"), "that")
    probe.until(lambda: arm.payloads[-1].verdict == 0, "that the payload is not known")
    assert "wait" in arm.payloads[-1].message
    arm.send(3.0, still=True)
    assert arm.until(JointEstimate.NO_MOTION).parameters_status == JointEstimate.CONVERGED
    arm.send(4.0)  # a second before the motion begins anew, with a jump
    check(arm.until(JointEstimate.CONVERGED))


@pytest.mark.long
def test_another_time_or_rate_begins_a_new_run_with_what_is_known(start, probe, motions, tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    arm = Arm(start, probe, motions, urdf=str(tmp_path / "arm.urdf"))
    arm.send(LEARN)
    arm.until(JointEstimate.CONVERGED)
    arm.k = 0
    arm.send(6.0)
    probe.until(lambda: probe.told("arm_identifier", "time jumped back"), "the jump")
    found = arm.until(JointEstimate.CONVERGED)
    check(found)
    assert found.window_end.sec < 1007
    answer = probe.call(Trigger, "/arm_identifier/reset", Trigger.Request())
    assert answer.success and answer.message == "forgot the arm"
    arm.send(3.0)
    arm.until(JointEstimate.TOO_SHORT)


def test_a_joint_that_is_not_there_is_named(start, probe, motions, tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    arm = Arm(start, probe, motions, JOINTS[:5], urdf=str(tmp_path / "arm.urdf"))
    arm.send(6.0)
    probe.until(lambda: probe.told("arm_identifier", "no samples of spin, which"), "the joint")
    assert arm.node.running


def test_a_bad_description_is_told_and_a_good_one_taken_instead(start, probe, motions):
    arm = Arm(start, probe, motions)
    arm.descriptions.publish(String(data=URDF[:500]))
    probe.until(lambda: probe.told("arm_identifier", "not XML"), "the fault")
    arm.descriptions.publish(String(data=URDF))
    probe.until(lambda: probe.told("arm_identifier", "learning"), "the description")
    arm.send(3.0)
    arm.until(JointEstimate.TOO_SHORT)


@pytest.mark.long
def test_a_state_file_of_another_arm_is_not_overwritten(start, probe, motions, tmp_path):
    state = tmp_path / "arm.json"
    state.write_text("{}")
    (tmp_path / "arm.urdf").write_text(URDF)
    arm = Arm(start, probe, motions, urdf=str(tmp_path / "arm.urdf"), state_file=str(state))
    arm.send(LEARN)
    arm.until(JointEstimate.CONVERGED)
    probe.until(lambda: probe.told("arm_identifier", "no file of joint_id"), "the file")
    answer = probe.call(Trigger, "/arm_identifier/save", Trigger.Request())
    assert not answer.success and state.read_text() == "{}"


def test_two_nodes_do_not_share_a_state_file(start, probe, tmp_path):
    state, urdf = tmp_path / "arm.json", tmp_path / "arm.urdf"
    state.write_text("{}")
    urdf.write_text(URDF)
    lock = FileLock(state)  # as a node that uses it
    lock.take()
    start("arm_identifier", urdf=str(urdf), state_file=str(state))
    probe.until(lambda: probe.told("arm_identifier", "is in use by another node"), "that")
    for name in ("save", "reset"):
        answer = probe.call(Trigger, f"/arm_identifier/{name}", Trigger.Request())
        assert not answer.success and "is in use by another node" in answer.message
    assert state.read_text() == "{}"
    lock.release()
    assert probe.call(Trigger, "/arm_identifier/reset", Trigger.Request()).success
    assert not state.exists()


BAD_PARAMETERS = {
    "no file": ({"urdf": "nowhere.urdf"}, "nowhere.urdf: cannot be read"),
    "gravity": ({"base_gravity": [0.0, 0.0, -981.0]}, "m/s^2"),
    "set": ({"set": ["k_t"]}, "is not of the form NAME=VALUE"),
    "nothing": ({"description_topic": ""}, "no description of the robot"),
}


@pytest.mark.parametrize("parameters, told", BAD_PARAMETERS.values(), ids=BAD_PARAMETERS)
def test_wrong_parameters_are_told(start, probe, parameters, told):
    node = start("arm_identifier", **parameters)
    probe.until(lambda: probe.told("arm_identifier", told), "the reason")
    assert node.running
