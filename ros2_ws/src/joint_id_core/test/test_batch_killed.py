"""A batch that is killed at any moment goes on, and its table is that of a run that was not disturbed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from .many_recordings import COMMAND, assert_same, rows, run_here, write_bags

PATIENCE_S = 300.0  # a limit for what hangs
PROGRAM = (sys.executable, "-c", "from joint_id_core.cli import main; main()", "batch", *COMMAND)
# Ends its process at the `number`-th part, or table, of which only a piece is on the disk.
KILLED = """
import os, signal, sys
from joint_id_core.batch import store
{patch}
from many_recordings import run_here
run_here(sys.argv[2:], sys.argv[1])
"""
HALF = """
left = [{number}]
def half(path):
    left[0] -= 1
    if not left[0]:
        path.write_bytes(path.read_bytes()[:100])
        os.kill(os.getpid(), signal.SIGKILL)
store._to_disk = half
"""
BEFORE_CLEARING = "store.LocalStore.clear = lambda self: os.kill(os.getpid(), signal.SIGKILL)"


def until(true, what: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < end, what
        time.sleep(0.02)


def children(pid: int) -> list[int]:
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_killed_batch_leaves_no_process_and_goes_on(tmp_path, run, in_this_process):
    write_bags(tmp_path / "logs", 8)
    undisturbed, output = tmp_path / "undisturbed.parquet", tmp_path / "out.parquet"
    assert run("batch", *COMMAND, tmp_path / "logs", "-o", undisturbed)[0] == 0
    process = subprocess.Popen(
        [*PROGRAM, "--jobs", "2", str(tmp_path / "logs"), "-o", str(output)], stderr=subprocess.DEVNULL
    )
    parts = Path(f"{output}.parts")
    until(lambda: parts.exists() and len(list(parts.glob("*.json"))) > 1, "two recordings are finished")
    own = children(process.pid)
    process.kill()
    process.wait()
    assert own and not output.exists()
    until(lambda: not any(map(alive, own)), "the processes of the batch end with it")
    before = {p.name: p.read_bytes() for p in parts.glob("*.json")}
    assert 1 < len(before) < 8
    code, out, _ = run("batch", *COMMAND, tmp_path / "logs", "-o", output)
    assert code == 0 and f" fitted, {len(before)} were finished before" in out
    assert_same(rows(output), rows(undisturbed))
    assert len(rows(output)) == 8 and not parts.exists()


@pytest.mark.long
@pytest.mark.parametrize(
    ("patch", "fitted"),
    [(HALF.format(number=3), 2), (HALF.format(number=5), 0), (BEFORE_CLEARING, 0)],
    ids=["part", "table", "before_clearing"],
)
def test_a_batch_killed_while_it_writes_goes_on(tmp_path, patch, fitted):
    bags = write_bags(tmp_path / "logs", 4)
    output = tmp_path / "out.parquet"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    shared = Path(__file__).with_name("many_recordings.py").read_text()
    (tmp_path / "many_recordings.py").write_text(shared)
    code = KILLED.format(patch=patch)
    died = subprocess.run([sys.executable, "-c", code, output, *bags], env=environment, timeout=PATIENCE_S, check=False)
    assert died.returncode == -signal.SIGKILL
    done = run_here(bags, output)
    assert (done.fitted, done.said) == (fitted, ())
    run_here(bags, tmp_path / "undisturbed.parquet")
    kept = [r | {"recording": ""} for r in rows(output)]
    assert len(kept) == 4 and kept == [r | {"recording": ""} for r in rows(tmp_path / "undisturbed.parquet")]
    assert not Path(f"{output}.parts").exists()
