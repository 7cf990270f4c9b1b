"""`joint-id doctor` finds what is wrong with a computer, and says what mends it."""

from __future__ import annotations

import json
import socket

import pytest
from typer.testing import CliRunner

from joint_id_core import doctor
from joint_id_core.cli import app


@pytest.fixture(autouse=True)
def no_other_packages(monkeypatch):
    """The checks of packages beside this one are tested there."""
    monkeypatch.setattr(doctor, "entry_points", lambda group: ())


def found(*words: str) -> tuple[int, dict[str, dict]]:
    done = CliRunner().invoke(app, ["doctor", "--json", *words])
    return done.exit_code, {c["name"]: c for c in json.loads(done.stdout)["checks"]}


def test_a_computer_that_has_all_but_ros_is_fine():
    code, seen = found()
    assert code == 0 and all(c["fine"] for c in seen.values() if c["needed"])
    assert {"Python", "numpy", "numba", "kernel cache", "kernels"} <= set(seen)
    assert not seen["ROS 2"]["fine"] and "make setup" in seen["ROS 2"]["mend"]


def test_a_cache_that_cannot_be_written_is_named_with_its_cause(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("JOINT_ID_CACHE_DIR", str(tmp_path / "file"))
    code, seen = found()
    assert code == 1 and not seen["kernel cache"]["fine"]
    assert (
        str(tmp_path / "file") in seen["kernel cache"]["text"] and "JOINT_ID_CACHE_DIR" in seen["kernel cache"]["mend"]
    )


def test_a_library_that_does_not_load_has_its_command(monkeypatch):
    real = doctor.import_module

    def load(name):
        if name in ("scipy", "torch"):
            raise ImportError(f"no {name}")
        return real(name)

    monkeypatch.setattr(doctor, "import_module", load)
    code, seen = found()
    assert code == 1 and "pip install scipy" in seen["scipy"]["mend"]
    assert not seen["torch"]["fine"] and not seen["torch"]["needed"] and "hpinn" in seen["torch"]["text"]
    text = CliRunner().invoke(app, ["doctor"]).stdout
    assert "wrong    scipy" in text and "missing  torch" in text


def test_a_robot_that_does_not_answer_is_named():
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        code, seen = found("--robot-ip", "127.0.0.1", "--port", str(unused.getsockname()[1]))
    assert code == 1 and "127.0.0.1" in seen["robot"]["text"] and "ping 127.0.0.1" in seen["robot"]["mend"]
