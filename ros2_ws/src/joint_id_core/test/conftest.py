"""Fixtures that several test files use."""

from __future__ import annotations

from concurrent.futures import Executor

import pytest
from hypothesis import settings
from typer.testing import CliRunner

from joint_id_core.batch import cores
from joint_id_core.cli import app, output
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.robots import build_joints

from .emulator_line import Line
from .examples import TIMES

# No test depends on the speed of the computer, and the first example may load compiled functions.
settings.register_profile("joint_id", deadline=None, max_examples=40 * TIMES)
settings.load_profile("joint_id")


class Here(Executor):
    """A pool of processes that is this process; it does the work as its results are asked for."""

    def __init__(self, *_, **__):
        pass

    map = staticmethod(map)


@pytest.fixture(autouse=True)
def no_progress(monkeypatch):
    """Commands in this process tell no progress, which they do after a time: the computer may be slow."""
    monkeypatch.setattr(output, "QUIET_S", 3600.0)


@pytest.fixture(autouse=True)
def fits_take_no_time(monkeypatch):
    """The online identifier fits as often as it may, and not more seldom where the computer is slow."""
    monkeypatch.setattr("time.thread_time", lambda: 0.0)


@pytest.fixture
def run(capsys):
    """Run a command in this process: (exit code, stdout, stderr)."""

    def call(*arguments):
        with pytest.raises(SystemExit) as end:
            app([str(a) for a in arguments], prog_name="joint-id")
        out, err = capsys.readouterr()
        return end.value.code, out, err

    return call


@pytest.fixture
def run_here(tmp_path, monkeypatch):
    """Run a command in this process and in the folder of the test: (exit code, all of its output)."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        result = CliRunner().invoke(app, [str(w) for w in words])
        return result.exit_code, result.output

    return call


@pytest.fixture
def in_this_process(monkeypatch):
    """Commands fit many recordings or joints in this process, which spares the start of others."""
    monkeypatch.setattr("joint_id_core.batch.run.on_cores", lambda work, found, _: cores.here(work, found))
    monkeypatch.setattr("joint_id_core.jobs.cores.ProcessPoolExecutor", Here)


@pytest.fixture
def open_line():
    """A function that opens a line to one emulated robot; at the end all lines are closed."""
    controller = Controller(build_joints("ur3e"), (), 0.0, (5, 13, 2, 77), ("joint_mode",))
    held, opened = {}, []

    def call():
        opened.append(Line(controller, held))
        return opened[-1]

    yield call
    for line in opened:
        line.client.close()
        line.connection.close()


@pytest.fixture
def line(open_line):
    """One line to an emulated robot."""
    return open_line()
