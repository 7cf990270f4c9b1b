"""`joint-id doctor` with ROS 2: our messages, DDS between two nodes, an emulated robot that answers."""

from __future__ import annotations

import json
import subprocess
import sys

from ros_domain import own_domain

from joint_id_core.emulator.process import EmulatorProcess


def test_ros_and_a_robot_are_found():
    with own_domain(), EmulatorProcess() as robot:
        command = [sys.executable, "-c", "from joint_id_core.cli import main; main()", "doctor", "--json"]
        done = subprocess.run(
            [*command, "--robot-ip", "127.0.0.1", "--port", str(robot.port)],
            capture_output=True, text=True, timeout=120,
        )  # fmt: skip
    found = {c["name"]: c for c in json.loads(done.stdout)["checks"]}
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(found[name]["fine"] for name in ("ROS 2", "messages", "DDS", "robot"))
    assert "answers" in found["robot"]["text"]
