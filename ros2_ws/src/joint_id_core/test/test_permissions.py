"""Files that the user may not read or write are told as that, and not as damaged."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from joint_id_core import formats
from joint_id_core.cli.group import BAD_INPUT

from .online_motion import motion

DROP_BOUND = 24  # PR_CAPBSET_DROP of prctl
ALL_FILES = (1, 2)  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH: with these root may read and write all files


def plain_user() -> None:
    """Take from a process what root may more than others; others may not drop it, and need not."""
    for capability in ALL_FILES:
        ctypes.CDLL(None).prctl(DROP_BOUND, capability, 0, 0, 0)


def command(folder: Path, *words: str) -> tuple[int, str]:
    """Run a command as a user whom permissions concern: exit code and stderr."""
    program = [sys.executable, "-c", "from joint_id_core.cli import main; main()", *words]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=120, preexec_fn=plain_user)
    return done.returncode, done.stderr


def test_a_bag_that_may_not_be_read_is_not_damaged(tmp_path):
    """It was "damaged or truncated: record it again"."""
    formats.write(tmp_path / "bag", motion(2.0))
    for file in ("bag.mcap", "metadata.yaml"):
        (tmp_path / "bag" / file).chmod(0)
        code, err = command(tmp_path, "info", "bag")
        (tmp_path / "bag" / file).chmod(0o644)
        if "no permission" not in err and code == 0:
            pytest.skip("this process may read all files")
        assert code == BAD_INPUT and err == f"joint-id: bag/{file}: no permission to read it: " + (
            "change that (chmod), or copy the bag\n"
        )


@pytest.mark.long
def test_of_an_output_the_message_is_about_writing(tmp_path):
    """It was "is not readable", also of a file that may be written, which is enough."""
    formats.write(tmp_path / "log.csv", motion(2.0))
    fit = ("fit", "log.csv", "--model", "rigid_joint", "--estimator", "regression", "--save")
    for name, mode in (("closed.json", 0), ("kept.json", 0o444)):
        (tmp_path / name).write_text("old")
        (tmp_path / name).chmod(mode)
        code, err = command(tmp_path, *fit, name)
        if code == 0:
            pytest.skip("this process may write all files")
        assert code == BAD_INPUT and f"{name}: the estimate cannot be written: Permission denied" in err
    (tmp_path / "drop.json").write_text("old")
    (tmp_path / "drop.json").chmod(0o200)
    assert command(tmp_path, *fit, "drop.json")[0] == 0
    assert (tmp_path / "drop.json").stat().st_size > 1000


def test_a_parameter_file_that_may_not_be_read_is_not_bad_yaml(tmp_path):
    formats.write(tmp_path / "log.csv", motion(2.0))
    (tmp_path / "robot.yaml").touch(0)
    code, err = command(tmp_path, "fit", "log.csv", "--robot", "robot.yaml")
    if "Permission" not in err:
        pytest.skip("this process may read all files")
    assert code == BAD_INPUT and err == "joint-id: robot.yaml: the file cannot be read: Permission denied\n"
