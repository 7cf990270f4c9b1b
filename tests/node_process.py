"""Nodes as processes: started as a user does, or forked from a process that has loaded their libraries already."""

from __future__ import annotations

import functools
import os
import runpy
import signal
import subprocess
import sys
from multiprocessing import get_context
from multiprocessing.forkserver import ensure_running
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

PATIENCE_S = 180.0  # a limit for tests that hang, not a measure of speed: the first fit of a model compiles it
STOP_S = 20.0  # until a node that should end is killed
# Imports and kernels are most of what a node computes before it is at work. The process that loads them has no threads,
# and nothing of DDS.
FORKS = get_context("forkserver")
FORKS.set_forkserver_preload(["loaded_nodes"])


@functools.cache
def _load() -> None:
    """Start that process; it looks for modules where the environment says."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
        ensure_running()


class Process:
    """A console script of joint_id_ros in its own process, whose output goes into a file."""

    def __init__(self, name: str, output: Path, arguments: list[str]) -> None:
        script = str(Path(get_package_prefix("joint_id_ros")) / "lib/joint_id_ros" / name)
        self.name, self._output = name, output
        output.touch()
        self._begin(script, arguments)

    def _begin(self, script: str, arguments: list[str]) -> None:
        _load()
        self._process = FORKS.Process(target=_run, args=(script, str(self._output), dict(os.environ), arguments))
        self._process.start()

    @property
    def text(self) -> str:
        """What the process has printed so far."""
        return self._output.read_text(errors="replace")

    @property
    def pid(self) -> int:
        """Number of the process."""
        return int(self._process.pid or 0)

    @property
    def running(self) -> bool:
        """Whether the process is there."""
        return bool(self._process.is_alive())

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to this process alone."""
        os.kill(self.pid, number)

    def wait(self, seconds: float = PATIENCE_S) -> int | None:
        """Exit code, once it has ended; None if it has not within this time."""
        self._process.join(seconds)
        return self._process.exitcode

    def stop(self) -> None:
        """End it, however it feels."""
        for number in (signal.SIGINT, signal.SIGKILL):
            if self.running:
                self.signal(number)
                self.wait(STOP_S)


class Program(Process):
    """The same, started as a user does: a new interpreter runs the script."""

    def _begin(self, script: str, arguments: list[str]) -> None:
        with self._output.open("w") as file:
            self._popen = subprocess.Popen([sys.executable, script, *arguments], stdout=file, stderr=subprocess.STDOUT)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._popen.pid

    @property
    def running(self) -> bool:
        """Whether the process is there."""
        return self._popen.poll() is None

    def wait(self, seconds: float = PATIENCE_S) -> int | None:
        """Exit code, once it has ended; None if it has not within this time."""
        try:
            return self._popen.wait(seconds)
        except subprocess.TimeoutExpired:
            return None

    def loaded(self, library: str) -> bool:
        """Whether it has loaded a library with this in its path."""
        return library in Path(f"/proc/{self._popen.pid}/maps").read_text()


def _run(script: str, output: str, environment: dict[str, str], arguments: list[str]) -> None:
    """Be the script, in a process that was forked."""
    file = os.open(output, os.O_WRONLY | os.O_APPEND)
    for number in (1, 2):
        os.dup2(file, number)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = [script, *arguments]
    runpy.run_path(script, run_name="__main__")
