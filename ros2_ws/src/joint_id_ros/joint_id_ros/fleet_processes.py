"""The processes of a fleet, each with its share of the robots; one that ends is started again."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence

AGAIN_S = 2.0  # after which a process that ended is started again
STOP_S = 15.0  # time to end after a signal
# Where the process that started it is killed, its standard input ends, and so does the fleet.
PROGRAM = """
import os, signal, sys, threading
def follow():
    os.read(0, 1)
    os.kill(os.getpid(), signal.SIGTERM)
threading.Thread(target=follow, daemon=True).start()
from joint_id_ros.running import fleet
sys.exit(fleet())
"""


class FleetProcesses:
    """Starts a process for each part of a fleet, and again where one has ended.

    Attributes:
        ended: number of processes that had to be started again.
    """

    def __init__(self, arguments: Sequence[Sequence[str]], tell: Callable[[str, str], None]) -> None:
        """Start them; `arguments` are those of each process, `tell` takes kind and text of a problem."""
        self.ended = 0
        self._arguments, self._tell = [list(own) for own in arguments], tell
        self._processes = [self._start(own) for own in self._arguments]
        self._again_s: dict[int, float] = {}

    @property
    def running(self) -> int:
        """Number of processes that run."""
        return sum(process.poll() is None for process in self._processes)

    def check(self) -> None:
        """Start again what has ended for some time."""
        now = time.monotonic()
        for k, process in enumerate(self._processes):
            if process.poll() is None:
                continue
            if k not in self._again_s:
                self.ended += 1
                self._again_s[k] = now + AGAIN_S
                self._tell(
                    "process ended", f"process {k + 1} ended with exit code {process.returncode}: starting again"
                )
            elif now >= self._again_s[k]:
                del self._again_s[k]
                self._processes[k] = self._start(self._arguments[k])

    def close(self) -> None:
        """End all, if needed by force."""
        for process in self._processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        end = time.monotonic() + STOP_S
        for process in self._processes:
            try:
                process.wait(max(0.1, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    @staticmethod
    def _start(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        # In a session of its own: Ctrl-C in a terminal reaches this process alone, which ends the others.
        return subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *arguments], stdin=subprocess.PIPE, start_new_session=True
        )
