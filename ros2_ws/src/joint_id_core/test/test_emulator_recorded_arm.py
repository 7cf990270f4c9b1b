"""An emulated arm as a process, recorded over RTDE by our own client, and what is found of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from joint_id_core.data.recording import Recording
from joint_id_core.emulator.process import EmulatorProcess
from joint_id_core.rtde.client import Request
from joint_id_core.rtde.socket_client import SocketClient

from .moving_arm import JOINTS, URDF

pytest.importorskip("pinocchio", reason="a robot's description needs Pinocchio")

from joint_id_core.arm.fit import fit_arm
from joint_id_core.emulator.links import GRIP

from .emulated_arm import ARM, AT_LINK, DRIVES, GAINS, PEAK, RATIO, ROBOT, values_of

MASS = 2.5  # kg
SILENCE_S = 30.0  # a limit for a process that hangs, not a measure of speed


@pytest.fixture(scope="module")
def urdf(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("arm") / "arm.urdf"
    file.write_text(URDF)
    return file


def recorded(client: SocketClient, seconds: float) -> dict[str, Recording]:
    """The next samples, by joint, without a gap."""
    samples = []
    while len(samples) < 500 * seconds:
        new = client.read(SILENCE_S)
        assert new, "the robot is silent"
        samples += new
    rows = {name: np.array([s.values[name] for s in samples]) for name in samples[0].values}
    np.testing.assert_allclose(np.diff(rows["timestamp"]), 0.002, atol=1e-9)
    found = {}
    for k, name in enumerate(JOINTS):
        channels = {
            "link_position": rows["actual_q"][:, k],
            "motor_velocity": RATIO * rows["actual_qd"][:, k],
            "current": rows["actual_current"][:, k],
        }
        found[name] = Recording(rows["timestamp"], channels, source="robot", joint=name)
    return found


@pytest.mark.long
def test_friction_rotors_and_payload_are_found_from_recordings_over_rtde(urdf):
    """In real time, so it takes 35 s."""
    options = ("--urdf", str(urdf), "--robot", ROBOT, "--amplitude", str(PEAK))
    with EmulatorProcess(*options) as robot:
        client = SocketClient(
            Request(robot.host, ("timestamp", "actual_q", "actual_qd", "actual_current"), port=robot.port)
        )
        client.open()
        try:
            client.start()
            free = recorded(client, 15.0)
            assert robot.tell(f"pick-up {MASS}").startswith("pick-up: the last link carries 2.5 kg")
            recorded(client, 1.0)
            carrying = recorded(client, 15.0)
        finally:
            client.close()
        assert robot.errors == ""  # the machine was fast enough
    found = fit_arm(ARM, [free], GAINS, payload=[carrying])
    assert found.converged and not found.doubts
    values, _ = values_of(found)
    np.testing.assert_allclose(values[:, 2], AT_LINK[:, 2], rtol=0.03)
    np.testing.assert_allclose(values[:, 1], AT_LINK[:, 1], rtol=0.06)
    np.testing.assert_allclose(values[1:, 0], AT_LINK[1:, 0], rtol=0.15)
    load = found.payload
    assert load is not None and abs(load.mass - MASS) < 4.0 * load.mass_std_dev < 0.05 * MASS
    np.testing.assert_allclose(load.centre, GRIP, atol=0.01)


def test_a_process_with_an_arm_says_what_it_can_and_cannot_do(urdf, tmp_path):
    truth = tmp_path / "truth.yaml"
    options = ("--urdf", str(urdf), "--robot", ROBOT, "--moving", "none", "--truth", str(truth))
    with EmulatorProcess(*options) as robot:
        known = yaml.safe_load(truth.read_text())
        assert known == {j.name: j.values for j in DRIVES}
        assert tuple(known) == JOINTS and "J_q" not in known["lift"]
        assert robot.tell("pick-up 1.5").startswith("pick-up: the last link carries 1.5 kg")
        assert robot.tell("put-down").startswith("put-down: the last link carries nothing")
        for command in ("pick-up 0", "pick-up -1", "pick-up"):
            robot.give(command)
        robot.give("pick-up 500")
        robot.wait_for_error("command pick-up: roll would need")
        assert robot.errors.count("write pick-up KG") == 3
    with EmulatorProcess("--moving", "none") as robot:
        robot.give("pick-up 1")
        robot.wait_for_error("command pick-up: the joints of this robot have no links that carry: start it with --urdf")


@pytest.mark.parametrize(
    ("change", "options", "told"),
    [
        (None, ("--base-gravity", "0,0,-9.81"), "--base-gravity needs the description of the robot: give --urdf, too"),
        (("", ""), ("--base-gravity", "0,0,-3"), "give three numbers in m/s^2"),
        (('type="fixed"', 'type="revolute"'), (), "those of the emulated robot are 6"),
        (('<mass value="3.0"/>', '<mass value="0"/>'), (), "link 'fore', which joint bend moves, has mass 0 kg"),
        (('<mass value="3.0"/>', '<mass value="300"/>'), (), "take a larger --robot, or less mass"),
        (("<robot", "<robots"), (), "not XML"),
    ],
)
def test_descriptions_that_are_of_no_use_are_refused(tmp_path, run, change, options, told):
    words = ["robot-emulator", "--port", "0", *options]
    if change is not None:
        file = tmp_path / "arm.urdf"
        file.write_text(URDF.replace(*change) if change[0] else URDF)
        words += ["--urdf", file]
    code, out, err = run(*words)
    assert code == 2 and not out and told in err and err.count("\n") == 1, err
