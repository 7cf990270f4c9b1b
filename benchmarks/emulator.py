"""The robot emulator as a child process, for the benchmarks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import TracebackType


class Emulator:
    """`joint-id robot-emulator` on a loopback address, as long as the `with` block lasts."""

    def __init__(self, host: str, port: int, *arguments: str) -> None:
        command = [sys.executable, "-c", "from joint_id_core.cli import main; main()", "robot-emulator"]
        self._process = subprocess.Popen(
            [*command, "--host", host, "--port", str(port), *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line.startswith("ready on "):
            self._process.wait()
            raise SystemExit(f"the emulator did not start: {line.strip() or 'see above'}")
        self.host, _, port_text = line.removeprefix("ready on ").strip().rpartition(":")
        self.port = int(port_text)

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._process.terminate()
        self._process.communicate()

    @property
    def cpu_s(self) -> float:
        """Processor time that it has used, in s."""
        return cpu_s(self._process.pid)

    def command(self, text: str) -> None:
        """Carry out a command of its standard input, e.g. a fault."""
        assert self._process.stdin is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()


def cpu_s(pid: int) -> float:
    """Processor time of a process so far, in s."""
    import os

    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
