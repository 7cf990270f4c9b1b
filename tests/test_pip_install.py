"""The library alone: pip installs it into a bare environment, without ROS and torch, with the command `joint-id`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CORE = Path(__file__).parents[1] / "ros2_ws/src/joint_id_core"

pytestmark = pytest.mark.long  # it downloads and installs half a dozen packages


@pytest.fixture(scope="module")
def bare(tmp_path_factory) -> Path:
    """A fresh environment with nothing but the library in it; skipped where pip finds no package index."""
    folder = tmp_path_factory.mktemp("bare")
    made_here = shutil.ignore_patterns("*.egg-info", "build", "__pycache__")
    source = shutil.copytree(CORE, folder / "source", ignore=made_here)
    python = folder / "env/bin/python"
    subprocess.run([sys.executable, "-m", "venv", folder / "env"], check=True)
    index = subprocess.run(
        [python, "-m", "pip", "download", "-q", "--no-deps", "-d", folder, "typer"], capture_output=True, check=False
    )
    if index.returncode:
        pytest.skip("no package index can be reached")
    subprocess.run([python, "-m", "pip", "install", "-q", source], check=True, timeout=900)
    return folder


def run(folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Run a program of the environment in an empty folder, without what this process has in its environment."""
    keep = {name: os.environ[name] for name in ("HOME", "JOINT_ID_CACHE_DIR") if name in os.environ}
    work = folder / "work"
    work.mkdir(exist_ok=True)
    path = {"PATH": f"{folder}/env/bin:/usr/bin:/bin"}
    return subprocess.run(command, cwd=work, env=keep | path, capture_output=True, text=True, timeout=300, check=False)


def test_the_command_simulates_and_fits(bare):
    made = run(bare, "joint-id", "simulate", "rigid_joint", "--duration", "3", "--out", "motion.csv")
    assert made.returncode == 0, made.stderr
    fitted = run(bare, "joint-id", "fit", "motion.csv", "--model", "rigid_joint", "--save", "joint.json")
    assert fitted.returncode == 0, fitted.stderr
    assert "rigid_joint by innovations: converged" in fitted.stdout


def test_a_robot_is_known_by_its_name(bare):
    designed = run(
        bare, "joint-id", "design", "--robot", "ur3e", "--joint", "elbow", "--model", "rigid_joint", "--time", "5"
    )
    assert designed.returncode == 0, designed.stderr


def test_python_reads_and_fits_a_bag_without_ros_and_torch(bare):
    code = (
        "import sys\nimport joint_id_core as jid\n"
        "model = jid.build('rigid_joint')\n"
        "jid.write('bag', jid.simulate_motion(model, 3.0))\n"
        "print(repr(jid.fit(model, jid.read('bag'))))\n"
        "assert not {'torch', 'rclpy', 'matplotlib'} & set(sys.modules)\n"
    )
    done = run(bare, "python", "-c", code)
    assert done.returncode == 0, done.stderr
    assert "converged" in done.stdout


def test_what_is_missing_is_named(bare):
    code = (
        "import joint_id_core as jid\n"
        "model = jid.build('rigid_joint')\n"
        "try:\n    jid.fit(model, jid.simulate_motion(model, 1.0), estimator=jid.HPinn())\n"
        "except jid.JointIdError as error:\n    print(error)\n"
    )
    done = run(bare, "python", "-c", code)
    assert done.returncode == 0, done.stderr
    assert "pip install torch" in done.stdout
