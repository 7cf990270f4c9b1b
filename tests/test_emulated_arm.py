"""A whole arm through the whole path: emulated robot, driver, then a bag and its fit, or filter and arm identifier."""

import json
import subprocess
import sys
import time

import pytest
import yaml
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from joint_id_msgs.msg import ArmPayload, JointEstimate, JointParams
from joint_id_ros.qos import LATEST

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")

pytestmark = pytest.mark.long
SECONDS, PATIENCE_S = 15.0, 180.0
NAMES = tuple(f"axis_{k}" for k in range(1, 7))
LINKS = (  # mass in kg, centre in m, axis of its joint, its place on the link before
    (8.0, "0 0.02 -0.03", "0 0 1", 'xyz="0 0 0.2"'),
    (6.0, "0.22 0 0.05", "0 1 0", 'xyz="0 0.1 0.05"'),
    (3.0, "0.18 0.01 0", "0 1 0", 'xyz="0.4 0 0"'),
    (1.2, "0 0.02 0.04", "1 0 0", 'xyz="0.35 0 0"'),
    (1.0, "0.01 0 0.05", "0 1 0", 'xyz="0 0 0.08"'),
    (0.8, "0.03 0 0.02", "0 0 1", 'xyz="0.02 0 0.08"'),
)


def description():
    """An arm of six joints."""
    parts = ['<robot name="arm"><link name="link_0"/>']
    for k, (mass, centre, axis, place) in enumerate(LINKS, 1):
        parts.append(
            f'<link name="link_{k}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
            f'<inertia ixx="{0.005 * mass}" iyy="{0.005 * mass}" izz="{0.005 * mass}" ixy="0" ixz="0" iyz="0"/>'
            f'</inertial></link><joint name="{NAMES[k - 1]}" type="continuous"><parent link="link_{k - 1}"/>'
            f'<child link="link_{k}"/><origin {place}/><axis xyz="{axis}"/></joint>'
        )
    return "".join([*parts, "</robot>"])


def joint_id(*words):
    """A command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", "from joint_id_core.cli import main; main()", *map(str, words)],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip


def test_a_recording_of_the_driver_tells_friction_rotors_and_the_payload(start, probe, robot, tmp_path):
    urdf, truth = tmp_path / "arm.urdf", tmp_path / "truth.yaml"
    urdf.write_text(description())
    machine = robot("--urdf", str(urdf), "--robot", "ur5e", "--amplitude", "1", "--truth", str(truth))
    links = probe.collect(JointState, "link_states")
    start("driver", robot_ip="127.0.0.1", port=machine.port, joints=list(NAMES), stall_s=20.0)
    probe.until(lambda: len(links) > 600, "samples")
    for bag, command in (("free", "put-down"), ("carrying", "pick-up 2.5")):
        machine.tell(command)
        words = ("record", tmp_path / bag, "link_states", "motor_states", "--duration", SECONDS)
        done = joint_id(*words)
        assert done.returncode == 0, done.stderr
    known = yaml.safe_load(truth.read_text())
    gains = [w for n in NAMES for w in ("--set", f"{n}.k_t={known[n]['k_t']}", "--set", f"{n}.N={known[n]['N']}")]
    done = joint_id("arm", "fit", urdf, tmp_path / "free", "--payload", tmp_path / "carrying", *gains, "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout)
    assert [j["name"] for j in found["joints"]] == list(NAMES)
    for j in found["joints"]:
        p = known[j["name"]]
        coulomb, viscous = p["N"] * p["tau_fm"] + p["tau_fq"], p["N"] ** 2 * p["c_m"] + p["c_q"]
        assert j["friction"]["value"] == pytest.approx(coulomb, rel=0.03)
        assert j["damping"]["value"] == pytest.approx(viscous, rel=0.06)
        assert j["r_squared"] > 0.98
    load = found["payload"]
    assert abs(load["mass"] - 2.5) < 4.0 * load["mass_std_dev"] < 0.2


def test_an_arm_at_work_is_identified_and_so_is_what_it_picks_up(start, probe, robot, tmp_path):
    """Driver, filter and arm identifier in real time."""
    urdf, truth = tmp_path / "arm.urdf", tmp_path / "truth.yaml"
    urdf.write_text(description())
    machine = robot("--urdf", str(urdf), "--robot", "ur5e", "--amplitude", "1", "--truth", str(truth))
    known = yaml.safe_load(truth.read_text())
    drives = [w for n in NAMES for w in (f"{n}.k_t={known[n]['k_t']}", f"{n}.N={known[n]['N']}")]
    found, payloads = probe.collect(JointParams, "joint_params", LATEST), probe.collect(ArmPayload, "payload", LATEST)
    start("filter", effort_source="current")
    start("arm_identifier", set=drives)
    described = probe.create_publisher(String, "robot_description", LATEST)
    described.publish(String(data=urdf.read_text()))
    start("driver", robot_ip="127.0.0.1", port=machine.port, joints=list(NAMES), stall_s=20.0)
    probe.until(lambda: len(payloads) and payloads[-1].verdict, "an arm that is known")
    probe.spin(5.0)
    # Where a joint sticks for a moment, half a second of motion may not be explained.
    probe.until(lambda: {j.status for j in found[-1].joints} == {JointEstimate.CONVERGED}, "joints that are explained")
    assert not payloads[-1].carries
    for joint in found[-1].joints:
        p, rows = known[joint.joint], {r.name: r for r in joint.parameters}
        coulomb, viscous = p["N"] * p["tau_fm"] + p["tau_fq"], p["N"] ** 2 * p["c_m"] + p["c_q"]
        assert rows["tau_f"].value == pytest.approx(coulomb, rel=0.05)
        assert rows["c"].value == pytest.approx(viscous, rel=0.1)
    for command, mass in (("pick-up 2.5", 2.5), ("put-down", 0.0), ("pick-up 1", 1.0)):
        machine.tell(command)
        at = time.time()  # stamps are of the wall clock
        probe.until(lambda mass=mass: payloads[-1].carries == (mass > 0.0), command)
        assert abs(payloads[-1].since.sec - at) < 4.0, payloads[-1].message
        probe.spin(6.0)
        assert time.time() - payloads[-1].header.stamp.sec < 4.0
        assert payloads[-1].carries == (mass > 0.0)
        if mass:
            assert payloads[-1].mass == pytest.approx(mass, abs=max(0.05, 4.0 * payloads[-1].mass_std_dev))
