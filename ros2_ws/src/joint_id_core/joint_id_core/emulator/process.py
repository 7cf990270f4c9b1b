"""The emulated robot as a separate process: for tests, benchmarks and demonstrations of programs that read robots."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from types import TracebackType
from typing import IO

from joint_id_core.errors import JointIdError

COMMAND = (sys.executable, "-c", "from joint_id_core.cli import main; main()", "robot-emulator")
PATIENCE_S = 180.0  # a limit for a process that hangs, not a measure of speed
STOP_S = 10.0  # time to end after SIGINT


class EmulatorProcess:
    """A process `joint-id robot-emulator` with its options as arguments, at a free port unless `--port` is given.

    Attributes:
        process: the process; its standard output and error are read by threads.
        lines: lines of its standard output, without line ends.
        complaints: lines of its standard error.
        ready: the line that says that it is ready.
        host, port: address and port at which it listens.

    Raises:
        JointIdError: the process ended before it was ready; the message has its exit code and its errors.
    """

    def __init__(self, *arguments: str, before: Sequence[str] = (), new_session: bool = False) -> None:
        """Start the process and wait until it listens.

        `before` is put before the command (e.g. `setpriv`). With `new_session`, Ctrl-C does not reach the process.
        """
        port = () if "--port" in arguments else ("--port", "0")
        self.process = subprocess.Popen(
            [*before, *COMMAND, *port, *arguments], start_new_session=new_session,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1,
        )  # fmt: skip
        self.lines: list[str] = []
        self.complaints: list[str] = []
        self._readers = [
            threading.Thread(target=_read, args=(self.process.stdout, self.lines), daemon=True),
            threading.Thread(target=_read, args=(self.process.stderr, self.complaints), daemon=True),
        ]
        for reader in self._readers:
            reader.start()
        self.ready = self.wait_for("ready on ")
        self.host, _, number = self.ready.removeprefix("ready on ").rpartition(":")
        self.port = int(number)

    def __enter__(self) -> EmulatorProcess:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def give(self, command: str) -> None:
        """Give a command, e.g. a fault."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{command}\n")
        self.process.stdin.flush()

    def tell(self, command: str) -> str:
        """Give a command, wait until it is done, and return the line that confirms it."""
        since = len(self.lines)
        self.give(command)
        return self.wait_for(f"{command.split()[0]}:", since)

    def wait_for(self, beginning: str, since: int = 0) -> str:
        """Wait for a line that starts with `beginning`, from line number `since` on, and return it."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            ended = self.process.poll() is not None
            if ended:
                for reader in self._readers:
                    reader.join()
            for line in self.lines[since:]:
                if line.startswith(beginning):
                    return line
            if ended:
                raise JointIdError(f"the emulator ended with exit code {self.process.returncode}: {self.errors}")
            time.sleep(0.005)
        raise JointIdError(f"the emulator did not say {beginning!r}: {self.lines} {self.errors}")

    @property
    def errors(self) -> str:
        """Text that the process has printed on standard error."""
        return "\n".join(self.complaints)

    def wait_for_error(self, text: str) -> None:
        """Wait until the process has printed `text` on standard error."""
        end = time.monotonic() + PATIENCE_S
        while text not in self.errors:
            if time.monotonic() > end:
                raise JointIdError(f"the emulator did not complain of {text!r}: {self.errors}")
            time.sleep(0.005)

    def stop(self) -> None:
        """End the process, if needed by force; can be called more than once."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        for reader in self._readers:
            reader.join()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            if stream is not None and not stream.closed:
                stream.close()


def _read(stream: IO[str], found: list[str]) -> None:
    found.extend(line.rstrip("\n") for line in iter(stream.readline, ""))
