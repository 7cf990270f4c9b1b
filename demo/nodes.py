"""The nodes of the system as child processes that never outlive the demo."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from ament_index_python.packages import get_package_prefix

from joint_id_core.emulator.process import EmulatorProcess

PATIENCE_S = 10.0  # to end after SIGINT, then after SIGTERM
TAIL = 15  # lines of a log that are shown when its process failed

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

# The kernel ends a child whose parent is gone, even when the parent was killed and could not clean up. A parent that
# was killed before the child has asked for this is no longer its parent, and then the child does not begin.
BEGIN_UNDER_PARENT = ["sh", "-c", '[ "$PPID" = "$0" ] && exec "$@"', str(os.getpid())]
BOUND_TO_PARENT = ["setpriv", "--pdeathsig", "TERM", *BEGIN_UNDER_PARENT] if shutil.which("setpriv") else []


class NodeFailedError(Exception):
    """A child process ended too early; the text contains the end of its log."""


class Nodes:
    """Starts nodes, and ends all of them when the `with` block is left.

    Every child is a session of its own: a Ctrl-C in the terminal reaches the demo alone, which then stops
    the children in order, so that the recorder can finish its bag.
    """

    def __init__(self, logs: Path) -> None:
        """`logs` is the folder that receives what the processes print."""
        logs.mkdir(parents=True, exist_ok=True)
        self.logs = logs
        self._children: dict[str, subprocess.Popen[Any]] = {}
        self._emulator: EmulatorProcess | None = None

    def __enter__(self) -> Nodes:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop(*reversed(self._children))

    def node(self, name: str, **parameters: object) -> None:
        """Start a node of joint_id_ros with ROS parameters."""
        arguments = [a for key, value in parameters.items() for a in ("-p", f"{key}:={_yaml(value)}")]
        self._start(name, "joint_id_ros", name, ["--ros-args", *arguments] if arguments else [])

    def record(self, bag: Path, topics: list[str]) -> None:
        """Start `joint-id record`."""
        self._start("record", "joint_id_core", "joint-id", ["record", str(bag), *topics])

    def emulator(self, host: str, truth: Path) -> EmulatorProcess:
        """Start `joint-id robot-emulator` at a free port; it listens when this returns.

        Raises:
            JointIdError: it ended instead.
        """
        with _signals_wait():
            emulator = EmulatorProcess("--host", host, "--truth", str(truth), before=BOUND_TO_PARENT, new_session=True)
            self._children["emulator"], self._emulator = emulator.process, emulator
        return emulator

    def _start(self, name: str, package: str, program: str, arguments: list[str]) -> None:
        # What `ros2 run` does; the launchers on the PATH are shells whose child a signal could miss.
        script = Path(get_package_prefix(package)) / "lib" / package / program
        with self._log(name).open("wb") as log, _signals_wait():
            self._children[name] = subprocess.Popen(
                [*BOUND_TO_PARENT, sys.executable, str(script), *arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                start_new_session=True,
            )  # fmt: skip

    def _log(self, name: str) -> Path:
        return self.logs / f"{name}.log"

    def check(self, may_end: str = "") -> None:
        """See that every process still runs.

        Raises:
            NodeFailedError: one ended that should not have, or with an error.
        """
        for name, child in self._children.items():
            code = child.poll()
            if code is not None and (code != 0 or name != may_end):
                robot = self._emulator if name == "emulator" else None
                lines = robot.complaints if robot else self._log(name).read_text(errors="replace").splitlines()[-TAIL:]
                raise NodeFailedError("\n  ".join([f"{name} ended with exit code {code}:", *lines]))

    def ended(self, name: str) -> bool:
        """Whether a node that ends by itself has done so.

        Raises:
            NodeFailedError: as `check`.
        """
        self.check(may_end=name)
        return self._children[name].poll() is not None

    def stop(self, *names: str) -> None:
        """End these nodes one after the other, by force if need be; the others keep running."""
        # A second Ctrl-C must not leave half of them.
        previous = {n: signal.signal(n, signal.SIG_IGN) for n in STOPPING}
        try:
            for name in names:
                _end(self._children.pop(name))
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Let signals wait meanwhile: one between the start of a child and its being noted would leave it running."""
    noted: list[int] = []
    previous = {n: signal.signal(n, lambda number, _: noted.append(number)) for n in STOPPING}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        for number in noted:
            signal.raise_signal(number)


def _end(child: subprocess.Popen[Any]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        if child.poll() is None:
            child.send_signal(number)
            end = time.monotonic() + PATIENCE_S
            while child.poll() is None and time.monotonic() < end:
                time.sleep(0.02)
    if child.poll() is None:
        os.killpg(child.pid, signal.SIGKILL)  # the child leads its group
        child.wait()


def _yaml(value: object) -> str:
    """A parameter value as the command line takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(f'"{v}"' for v in value) + "]"
    return f'"{value}"' if isinstance(value, (str, Path)) else str(value)
