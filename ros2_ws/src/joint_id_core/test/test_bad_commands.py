"""What a command cannot do ends in one line and exit code 2; it harms no file."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from joint_id_core import formats
from joint_id_core.cli.group import BAD_INPUT
from joint_id_core.errors import JointIdError
from joint_id_core.text_file import write_text

from .online_motion import motion


def run(folder: Path, *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from joint_id_core.cli import main; main()", *map(str, words)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.fixture
def log(tmp_path):
    formats.write(tmp_path / "log.csv", motion(4.0))
    return "log.csv"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fit", "LOG", "--fix", "J", "--free", "J"), "--fix J and --free J exclude each other"),
        (("fit", "LOG", "--fix", "J=2", "--set", "J=3"), "--fix J and --set J both give a value"),
        (("simulate", "rigid_joint", "--out", "x.mat"), "is written as .csv, or else as a bag"),
        (("simulate", "rigid_joint", "--out", "x.csv", "--duration", "1e9"), "5e+11 samples: at most"),
        (("fit", "LOG", "--model", "rigid_joint", "--set", "tauf=1"), "no parameter 'tauf' (did you mean tau_f?)"),
        (("fit", "LOG", "--model", "rigid_jont"), "'rigid_jont' (did you mean rigid_joint?)"),
        (("fit", "LOG", "--estimator", "regresion"), "'regresion' (did you mean regression?)"),
        (("fit", "LOG", "--map", "torqe=torque"), "'torqe' (did you mean torque?)"),
        (("fit", "LOG", "--model", "rigid_joint", "--set", "xyz=1"), "no parameter 'xyz': it has J"),
        (("fit", "a" * 300 + ".csv"), "File name too long"),
        (("info", "a" * 300 + ".csv"), "File name too long"),
        (("fit", "LOG", "--save", "no/such/e.json"), "the estimate cannot be written"),
        (("report", "LOG", "-o", "."), "cannot be written"),
        (("simulate", "rigid_joint", "--out", "no/such/x.csv"), "cannot be written"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path, log, words, said):
    done = run(tmp_path, *(log if w == "LOG" else w for w in words))
    assert done.returncode == BAD_INPUT
    # A slow computer tells before that it loads or compiles a kernel.
    (line,) = (t for t in done.stderr.splitlines() if not t.startswith(("joint-id: loading ", "joint-id: compiling ")))
    assert said in line
    assert not [p for p in tmp_path.rglob("*") if p.name != log]


def test_a_full_disk_is_named_and_what_is_there_stays(tmp_path):
    """A device that is always full is also not replaced by a file."""
    full = Path("/dev/full")
    if not full.is_char_device():
        pytest.skip("this computer has no /dev/full")
    with pytest.raises(JointIdError, match="the estimate cannot be written: No space left on device"):
        write_text(full, "text", "the estimate")
    assert stat.S_ISCHR(os.stat(full).st_mode)
    (tmp_path / "old").write_text("old")
    (tmp_path / "old.part").mkdir()  # where the new one would be made
    with pytest.raises(JointIdError):
        write_text(tmp_path / "old", "new", "the estimate")
    assert (tmp_path / "old").read_text() == "old"


@pytest.mark.parametrize(
    "words", [("fit", "--estimator", "regression", "--save", "é.json"), ("report", "-o", "é.html")]
)
def test_a_locale_without_the_characters_loses_no_result(tmp_path, log, words):
    (tmp_path / log).rename(tmp_path / "mesuré.csv")
    plain = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-c", "from joint_id_core.cli import main; main()", words[0], "mesuré.csv", *words[1:]]
    done = subprocess.run(
        [*command, "--model", "rigid_joint"], cwd=tmp_path, env=os.environ | plain, capture_output=True, timeout=120
    )
    assert done.returncode == 0 and b"Traceback" not in done.stderr, done.stderr
    assert (tmp_path / words[-1]).stat().st_size > 1000
