"""Node `filter` with the description of an arm: the load in its samples, what the identifier makes of it, bad input."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from core_arm import moving_arm
from robot_messages import NANO, stamp
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from joint_id_msgs.msg import JointEstimate, JointParams, JointSamples
from joint_id_ros.qos import LATEST

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")
pytest.importorskip("mujoco", reason="the arm of these tests is one of MuJoCo")

from joint_id_core.arm.description import Description
from joint_id_core.arm.loaded import loaded
from joint_id_core.arm.typical_inertia import typical_inertia

BEGIN = 100 * NANO
JOINTS, URDF, RATE = moving_arm.JOINTS, moving_arm.URDF, moving_arm.RATE
LAG = 200  # samples that both filters hold at the end, and some more


@pytest.fixture(scope="module")
def arm():
    """Recordings of six joints that move for longer than any test needs."""
    return moving_arm.rigid(120.0)


def newest(found: list[JointParams], joint: str) -> JointEstimate | None:
    """The newest estimate of a joint; those of a source that falls silent are taken back."""
    return next((j for message in reversed(found) for j in message.joints if j.joint == joint), None)


class Playing:
    """A filter, and the joints of the arm that are published for it."""

    def __init__(self, start, probe, arm, names=JOINTS, **parameters) -> None:
        self.probe, self.names, self.sent = probe, names, 0
        self.position = np.column_stack([arm[n]["link_position"] for n in JOINTS])[:, : len(names)]
        self.torque = np.column_stack([arm[n]["torque"] for n in JOINTS])[:, : len(names)]
        self.samples = probe.collect(JointSamples, "joint_samples")
        self.filter = start("filter", effort_source="torque", gear_ratio=1.0, join_wait_s=0.2, **parameters)
        self.links = probe.source(JointState, "link_states")
        probe.until(lambda: probe.get_publishers_info_by_topic("joint_samples"), "the filter's publisher")
        self.descriptions = probe.create_publisher(String, "robot_description", LATEST)

    def send(self, seconds: float) -> None:
        """Publish so many seconds, and wait for what the filter makes of them."""
        for k in range(self.sent, self.sent + round(seconds * RATE)):
            message = JointState(name=list(self.names))
            message.position, message.effort = self.position[k].tolist(), self.torque[k].tolist()
            message.header.stamp = stamp(BEGIN + round(k * NANO / RATE))
            self.links.publish(message)
        self.sent += round(seconds * RATE)
        self.probe.until(lambda: len(self.samples) >= self.sent - LAG, "the samples")

    def send_until(self, condition: Callable[[], object], what: str) -> None:
        """Publish on until the condition holds: estimates are published with samples, and fits take their time."""
        while not condition() and self.sent < len(self.position) - RATE:
            self.send(0.5)
            self.probe.spin(0.1)
        self.probe.until(condition, what)

    def loads(self) -> np.ndarray:
        """The loads that came so far, shape (T, joints)."""
        return np.array([list(s.external_torque) for s in self.samples])


def test_a_description_that_comes_late_gives_the_load_and_a_joint_is_identified(start, probe, arm):
    found = probe.collect(JointParams, "joint_params", LATEST)
    start("identifier", model="rigid_joint", actuation="torque", joints=["lift", "tilt"])
    playing = Playing(start, probe, arm, description_topic="robot_description")
    probe.until(lambda: probe.count_subscribers("joint_samples") >= 2, "the identifier")
    playing.send(4.0)
    assert np.isnan(playing.loads()).all(), "it is not known yet"
    probe.until(lambda: probe.told("filter", "no description on /robot_description yet"), "the reason")

    def has(joint: str, status: int) -> bool:
        estimate = newest(found, joint)
        return estimate is not None and estimate.status == status

    playing.send_until(lambda: has("lift", JointEstimate.MISSING_SIGNAL), "what is missing")
    assert "load of the rest of the arm" in newest(found, "lift").message
    playing.descriptions.publish(String(data=URDF))
    probe.until(lambda: probe.told("filter", "of /robot_description"), "the description")
    begin = playing.sent
    playing.send(10.0)
    description, end = Description(URDF), playing.sent
    sent = {name: recording.slice(0, end) for name, recording in arm.items()}
    for k, name in enumerate(JOINTS):
        whole = loaded(description, name, [sent]).recordings[0]
        time = np.array([s.header.stamp.sec + s.header.stamp.nanosec / NANO for s in playing.samples]) - BEGIN / NANO
        load = playing.loads()[:, k]
        rows = (time > begin / RATE + 0.6) & (time < end / RATE - 1.0)  # a filter that begins is settled by then
        assert np.isfinite(load[rows]).all()
        right = np.interp(time[rows], whole.time, whole["external_torque"])
        assert np.abs(load[rows] - right).max() < 0.01 * np.std(right)
    assert not any(s.measured & JointSamples.EXTERNAL_TORQUE for s in playing.samples)
    for name in ("lift", "tilt"):
        playing.send_until(lambda name=name: has(name, JointEstimate.CONVERGED), "an estimate")
        k, rows = JOINTS.index(name), {p.name: p for p in newest(found, name).parameters}
        truth = {"J": moving_arm.ROTOR[k] + typical_inertia(description)[k], "c": moving_arm.VISCOUS[k]}
        for parameter, value in truth.items():
            row = rows[parameter]
            assert abs(row.value - value) < 4.0 * row.std_dev < 0.2 * value, (name, parameter, row.value, value)


def test_a_bad_description_is_told_and_a_good_one_taken_instead(start, probe, arm):
    playing = Playing(start, probe, arm, description_topic="robot_description")
    playing.descriptions.publish(String(data=URDF[:500]))
    playing.send(1.5)
    probe.until(lambda: probe.told("filter", "the load of the arm is not known: /robot_description: not XML"), "that")
    assert np.isnan(playing.loads()).all()
    playing.descriptions.publish(String(data=URDF))
    probe.until(lambda: probe.told("filter", "of /robot_description"), "the description")
    playing.send(2.0)
    assert np.isfinite(playing.loads()[-1]).all()
    assert playing.filter.running


BAD_NAMES = {
    "five of six": (JOINTS[:5], "no position of spin, which the description moves (there are turn, "),
    "a prefix": (tuple(f"left_{n}" for n in JOINTS), f"no position of {', '.join(JOINTS)}"),
}


@pytest.mark.parametrize("names, told", BAD_NAMES.values(), ids=BAD_NAMES)
def test_joints_that_do_not_match_are_named_and_the_filter_goes_on(start, probe, arm, tmp_path, names, told):
    (tmp_path / "arm.urdf").write_text(URDF)
    playing = Playing(start, probe, arm, names, urdf=str(tmp_path / "arm.urdf"))
    playing.send(2.0)
    probe.until(lambda: probe.told("filter", told), "the names")
    assert np.isnan(playing.loads()).all() and len(playing.samples[-1].link_acceleration) == len(names)


@pytest.mark.long
def test_gravity_that_acts_elsewhere_is_told_with_the_parameter_to_set(start, probe, tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    parameters = {"urdf": str(tmp_path / "arm.urdf"), "base_gravity": [0.0, 0.0, 9.81]}
    playing = Playing(start, probe, moving_arm.rigid(16.0, 5), **parameters)
    for _ in range(30):
        playing.send(0.5)
    probe.until(lambda: probe.told("filter", "give base_gravity:=[0.0, 0.0, -9.81] if"), "the other gravity")
    status = probe.told("filter", "fit gravity along 0,0,-9.81 m/s^2")
    assert status.level in (b"\x01", b"\x02")  # an error where a loaded computer reads samples late as well
    assert np.isfinite(playing.loads()[-1]).all(), "the load goes on"


def test_without_a_description_there_is_no_load_and_the_identifier_says_which_one_it_lacks(start, probe, arm):
    found = probe.collect(JointParams, "joint_params", LATEST)
    start("identifier", model="rigid_joint", actuation="torque", joints=["lift"])
    playing = Playing(start, probe, arm)
    probe.until(lambda: probe.count_subscribers("joint_samples") >= 2, "the identifier")
    playing.send(4.0)
    assert not any(len(s.external_torque) for s in playing.samples)
    others = [name for name in JOINTS if name != "lift"]

    def told() -> bool:
        lift = newest(found, "lift")
        text = lift.message if lift is not None else ""
        return "Other joints move, too" in text and "description_topic" in text and all(name in text for name in others)

    playing.send_until(told, "which joints, and what is missing")


BAD_PARAMETERS = {
    "no file": ({"urdf": "nowhere.urdf"}, "nowhere.urdf: cannot be read"),
    "two": ({"urdf": "a.urdf", "description_topic": "robot_description"}, "leave one out"),
    "gravity": ({"description_topic": "robot_description", "base_gravity": [0.0, 0.0, -981.0]}, "m/s^2"),
    "no gravity in the effort": (
        {"description_topic": "robot_description", "effort_source": "gravity_free_torque"},
        "set base_gravity to [0.0, 0.0, 0.0]",
    ),
}


@pytest.mark.parametrize("parameters, told", BAD_PARAMETERS.values(), ids=BAD_PARAMETERS)
def test_wrong_parameters_end_the_filter_with_one_line(start, probe, parameters, told):
    process = start("filter", **parameters)
    assert process.wait() == 2
    (line,) = process.text.strip().splitlines()
    assert line.startswith("filter: ") and told in line


@pytest.mark.long
def test_the_identifier_matches_the_load_of_other_masses_to_the_motion(start, probe, arm, tmp_path):
    """The description of the user has masses that are 40 % too large; as computed, the load leaves poor fits."""
    masses = re.sub(r'mass value="([^"]*)"', lambda found: f'mass value="{1.4 * float(found[1])}"', URDF)
    (tmp_path / "arm.urdf").write_text(masses)
    found = probe.collect(JointParams, "joint_params", LATEST)
    start("identifier", model="rigid_joint", actuation="torque", joints=["lift"], urdf=str(tmp_path / "arm.urdf"))
    playing = Playing(start, probe, arm, urdf=str(tmp_path / "arm.urdf"))
    probe.until(lambda: probe.count_subscribers("joint_samples") >= 2, "the identifier")

    def matched() -> JointEstimate | None:
        lift = newest(found, "lift")
        return lift if lift is not None and "The load was matched to the motion" in lift.message else None

    def up_to_s() -> float:
        """End of the newest window in s after the first sample."""
        lift = newest(found, "lift")
        return -np.inf if lift is None else lift.window_end.sec + lift.window_end.nanosec / NANO - BEGIN / NANO

    for k in range(24):  # a fit of the newest seconds takes its time: no sample waits so long that it is left out
        playing.send(0.5)
        if k >= 8:
            probe.until(lambda: up_to_s() > playing.sent / RATE - 1.5, "an estimate of these samples")
    playing.send_until(matched, "an estimate with a load that is matched")
    lift = matched()
    assert lift.status == JointEstimate.CONVERGED, lift.message
    k, rows = JOINTS.index("lift"), {p.name: p for p in lift.parameters}
    for name, truth in (("c", moving_arm.VISCOUS[k]), ("tau_f", moving_arm.COULOMB[k])):
        assert abs(rows[name].value - truth) < 4.0 * rows[name].std_dev < 0.3 * truth, (name, rows[name], truth)
