"""What a command cannot do ends in one line and exit code 2; it harms no file."""

from __future__ import annotations

import os
import shutil
import signal
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from joint_id_core import formats
from joint_id_core.cli.group import BAD_INPUT, not_written
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.text_file import require_writable, write_text

from .online_motion import motion


@pytest.fixture
def here(tmp_path, monkeypatch, run):
    """Run a command in this process and in the folder of the test: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    return run


def test_a_group_without_a_command_shows_its_commands(here):
    code, _, err = here("arm")
    assert code == BAD_INPUT and "\n  friction-scales " in err and "\n  fit " in err


@pytest.fixture
def log(tmp_path):
    formats.write(tmp_path / "log.csv", motion(4.0))
    return "log.csv"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fit", "LOG", "--fix", "J", "--free", "J"), "--fix J and --free J exclude each other"),
        (("fit", "LOG", "--fix", "J=2", "--set", "J=3"), "--fix J and --set J both give a value"),
        (("simulate", "--out", "x.csv"), "which model? joint-id simulate MODEL --out FILE; there are dc_motor, "),
        (("simulate", "dc_motor", "--model", "rigid_joint", "--out", "x"), "two models: dc_motor and --model rigid_"),
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
        (("report", "LOG", "-o", "page.pdf"), "the report is a page of HTML, which a browser can print"),
        (("fit", "LOG", "--plot", ""), "not the name of a picture"),
        (("simulate", "rigid_joint", "--out", "x", "--joint", ""), "--joint is empty"),
        (("simulate", "rigid_joint", "--out", "no/such/x.csv"), "cannot be written"),
        (("simulate", "rigid_joint", "--out", "x.csv", "--seed", "-1"), "--seed -1: give a number from 0 on"),
        (("simulate", "rigid_joint", "--out", "x.csv", "--joint", "elbow"), "a CSV file holds no name of a joint"),
        (("fit", "LOG", "--start", "-1"), "--start -1: give a time"),
        (("fit", "LOG", "--end", "nan"), "--end nan: give a time"),
        (("fit", "LOG", "--model", "rigid_joint", "--set", "J=2+-0.1"), "--set J: +- is for a parameter that is held"),
        (("fit", "LOG", "LOG"), "log.csv is given twice"),
        (("fit", "LOG", "--model", "rigid_joint", "--free", "N=3"), "--free N=3: give the name alone"),
        (("fit", "LOG", "--model", "rigid_joint", "--fix", "J=0"), "model rigid_joint divides by it"),
        (("fit", "LOG", "--model", "rigid_joint", "--set", "J=0"), "model rigid_joint divides by it"),
        (("fit", "LOG", "--free", "k_t"), "model rigid_joint has no parameter 'k_t' without --actuation current"),
        (("fit", "LOG", "--epochs", "10"), "innovations has no option epochs: leave it out, or take --estimator hpinn"),
        (("fit", "LOG", "--model", "rigid_joint", "--set", "J=1e30"), "J = 1e+30 kg m^2: no joint comes near it"),
        (("fit", "LOG", "--model", "rigid_joint", "--fix", "c=1e300"), "give a value nearer to the usual 10"),
        (("fit", "LOG", "--model", "rigid_joint", "--prior", "J=1e300"), "give one from 1e-30 to 1e+30"),
        (("fit", "LOG", "--model", "rigid_joint", "--estimator", "hpinn", "--learning-rate", "0"), "learning_rate = 0"),
        (("fit", "LOG", "--estimator", "hpinn", "--learning-rate", "1e9"), "learning_rate = 1000000000.0 : must be in"),
        (("fit", "LOG", "--estimator", "regression", "--band-hz", "900"), "band_hz = 900 Hz needs more than 1800"),
        (("doctor", "--port", "30004"), "--port is that of a robot: give --robot-ip, too"),
        (("arm", "fit"), "Missing argument 'urdf'. See joint-id arm fit --help"),
        (("arm", "ftt"), "No such command 'ftt'. Did you mean 'fit'? See joint-id arm --help"),
        (("fit", "LOG", "--plot", "a", "--save", "a"), "--save a would overwrite a file that --plot writes"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path, here, log, words, said):
    code, out, err = here(*(log if w == "LOG" else w for w in words))
    assert (code, out) == (BAD_INPUT, "")
    (line,) = err.splitlines()
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


@pytest.mark.long
@pytest.mark.parametrize(
    "words",
    [
        ("fit", "--estimator", "regression", "--save", "é.json"),
        pytest.param(("report", "-o", "é.html"), marks=pytest.mark.long),
    ],
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


@pytest.mark.parametrize(
    "words",
    [
        ("fit", "log.csv", "--save", "log.csv"),
        ("fit", "log.csv", "--save", "./log.csv"),
        ("fit", "log.csv", "--plot", "log.csv"),
        ("fit", "other.csv", "--validate", "log.csv", "--save", "log.csv"),
        ("fit", "other.csv", "--save", "link", "--validate", "log.csv"),
        ("report", "log.csv", "-o", "log.csv"),
        ("report", "other.csv", "--against", "log.csv", "-o", "log.csv"),
    ],
)
def test_no_output_takes_the_place_of_an_input(tmp_path, here, log, words):
    shutil.copy(tmp_path / log, tmp_path / "other.csv")
    (tmp_path / "link").symlink_to(log)
    before = (tmp_path / log).read_bytes()
    code, _, err = here(*words)
    assert code == BAD_INPUT and "would overwrite a file that is read by this command" in err
    assert (tmp_path / log).read_bytes() == before


def test_a_check_of_an_output_leaves_all_as_it_was(tmp_path):
    (tmp_path / "kept.json").write_text("old")
    (tmp_path / "latest.json").symlink_to("new.json")  # which is not there
    for name in ("kept.json", "latest.json", "other.json"):
        require_writable(tmp_path / name, "the estimate")
    assert (tmp_path / "kept.json").read_text() == "old" and (tmp_path / "latest.json").is_symlink()
    assert {p.name for p in tmp_path.iterdir()} == {"kept.json", "latest.json"}


def test_a_link_to_another_file_stays_a_link(tmp_path):
    (tmp_path / "kept.json").write_text("old")
    (tmp_path / "latest.json").symlink_to("kept.json")
    write_text(tmp_path / "latest.json", "new", "the estimate")
    assert (tmp_path / "latest.json").is_symlink() and (tmp_path / "kept.json").read_text() == "new"


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_an_output_that_is_full_is_said(option):
    full = Path("/dev/full")
    if not full.is_char_device():
        pytest.skip("this computer has no /dev/full")
    command = [sys.executable, "-c", "from joint_id_core.cli import main; main()", option]
    with full.open("w") as out:
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode == BAD_INPUT and done.stderr.count("\n") == 1 and "No space left" in done.stderr


LONG = pytest.mark.long


@pytest.mark.parametrize("wait_s", [0.1, 0.4, 0.8, *(pytest.param(s, marks=LONG) for s in (0.2, 0.3, 0.6, 1.1))])
def test_ctrl_c_ends_the_command_wherever_it_is(tmp_path, log, wait_s):
    """While libraries load, an interrupt once was lost, or ended in a traceback."""
    # As the launcher begins; a shell in the background would have it ignore interrupts.
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    start = f"{heard}; from joint_id_core.command import main; print('begun', flush=True); main()"
    command = [sys.executable, "-c", start, "report", log, "-o", "page.html"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"  # before that it is the interpreter that starts
    try:
        process.communicate(timeout=wait_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT and "Traceback" not in told, told


def test_a_recording_to_predict_is_checked_as_well(tmp_path, here, log):
    record = formats.read(tmp_path / log)
    wrong = record.with_channels({"link_position": np.rad2deg(record["link_position"])})
    formats.write(tmp_path / "degrees.csv", wrong)
    _, out, err = here("fit", log, "--model", "rigid_joint", "--validate", "degrees.csv")
    assert "degrees.csv could not be predicted" in err and "degrees" in out + err


@pytest.mark.parametrize("words", [("fit", "--model", "rigid_joint"), ("compare",)])
@pytest.mark.parametrize("same", ["log.csv", "link.csv"])
def test_a_recording_is_no_test_of_its_own_fit(tmp_path, here, log, words, same):
    (tmp_path / "link.csv").symlink_to(log)
    code, out, err = here(words[0], log, *words[1:], "--validate", same)
    assert (code, out) == (BAD_INPUT, "")
    assert f"--validate {same}: the same recording is no test of its fit: give another one" in err


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda r: Recording(1e3 * r.time, r.channels), "time seems to be in milliseconds"),
        (lambda r: r.slice(0, 20), "a fit needs"),
    ],
)
def test_a_recording_that_cannot_be_predicted_does_not_lose_the_fit(tmp_path, here, log, change, told):
    formats.write(tmp_path / "other.csv", change(motion(2.0)))
    code, out, _ = here("fit", log, "--model", "rigid_joint", "--validate", "other.csv", "--save", "kept.json")
    assert code == BAD_INPUT and "estimated" in out and (tmp_path / "kept.json").exists()
    line = next(line for line in out.splitlines() if line.startswith("held out, other.csv: not predicted"))
    assert told in line and "nrmse" not in line


def test_a_recording_that_is_predicted_worse_than_by_its_mean_is_said(tmp_path, here, log):
    record = formats.read(tmp_path / log)
    formats.write(tmp_path / "other.csv", record.with_channels({"torque": -record["torque"]}))
    code, out, err = here("fit", log, "--model", "rigid_joint", "--validate", "other.csv")
    assert code == 0 and "R^2 -" in out and "worse than by its mean: the fit does not hold there" in err


@pytest.mark.parametrize(
    ("change", "status"),
    [
        (lambda r: Recording(1e3 * r.time, r.channels), "bad_data"),
        (lambda r: r.slice(0, 20), "too_short"),
        (lambda r: Recording(r.time, {"torque": r["torque"]}), "missing_signal"),
    ],
)
def test_where_nothing_was_fitted_the_message_is_all(tmp_path, here, change, status):
    formats.write(tmp_path / "other.csv", change(motion(2.0)))
    code, out, err = here("fit", "other.csv", "--model", "rigid_joint")
    assert code == BAD_INPUT and f"joint-id: {status}: " in err
    head, message = out.splitlines()
    assert head == f"rigid_joint by innovations: {status}" and message.strip() in err
    assert "design" in here("fit", "other.csv", "--model", "rigid_joint", "--json")[1]


def test_a_link_that_leads_to_itself_is_said(tmp_path, here):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    code, _, err = here("fit", "loop.csv", "--model", "rigid_joint")
    assert code == BAD_INPUT and err.count("\n") == 1 and "loop.csv" in err


@pytest.mark.parametrize("command", [("watch",), ("record", "run1"), ("fleet", "robots.yaml")])
def test_a_command_of_the_nodes_says_where_it_comes_from(here, command):
    """The library alone said "No such command 'watch'. Did you mean 'batch'?"."""
    code, _, err = here(*command)
    assert code == BAD_INPUT and err.count("\n") == 1
    assert f"joint-id: {command[0]} comes with the nodes" in err and "colcon build" in err


def test_a_folder_that_is_gone_and_a_library_without_memory_are_no_output(tmp_path, monkeypatch, capsys):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(OSError) as gone:
        os.getcwd()
    not_written(gone.value)
    not_written(OSError("Could not find/load shared object file 'libllvmlite.so'"))
    folder, library = capsys.readouterr().err.splitlines()
    assert folder == "joint-id: the folder in which this command runs is gone: change to another one (cd)"
    assert "libllvmlite.so" in library and "memory" in library and "None" not in library
