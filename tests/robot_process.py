"""An emulated robot in its own process, and a reader of its stream that shares no code with the driver."""

from __future__ import annotations

import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from ament_index_python.packages import get_package_prefix

PATIENCE_S = 60.0  # a limit for tests that hang
SCRIPT = Path(get_package_prefix("joint_id_core")) / "lib/joint_id_core/joint-id"


class Robot:
    """`joint-id robot-emulator` on a port of its own."""

    def __init__(self, *arguments: str, port: int = 0) -> None:
        self._popen = subprocess.Popen(
            [sys.executable, str(SCRIPT), "robot-emulator", "--port", str(port), *arguments],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1,
        )  # fmt: skip
        self.lines: list[str] = []
        self.complaints: list[str] = []
        for stream, lines in ((self._popen.stdout, self.lines), (self._popen.stderr, self.complaints)):
            threading.Thread(
                target=lambda s=stream, found=lines: found.extend(iter(s.readline, "")), daemon=True
            ).start()
        self.port = int(self._wait_for("ready on ", 0).rpartition(":")[2])

    def _wait_for(self, beginning: str, since: int) -> str:
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            for line in self.lines[since:]:
                if line.startswith(beginning):
                    return line
            assert self._popen.poll() is None, f"the emulator ended: {self.complaints}"
            time.sleep(0.005)
        raise AssertionError(f"the emulator did not say {beginning!r}: {self.lines} {self.complaints}")

    def tell(self, command: str) -> None:
        """Give a command and wait until it is carried out."""
        assert self._popen.stdin is not None
        since = len(self.lines)
        self._popen.stdin.write(command + "\n")
        self._wait_for(command.split()[0], since)

    def stop(self) -> None:
        """End it."""
        if self._popen.poll() is None:
            self._popen.send_signal(signal.SIGINT)
            try:
                self._popen.wait(10.0)
            except subprocess.TimeoutExpired:
                self._popen.kill()
                self._popen.wait()


class Reader:
    """Reads the same stream as the driver, as plainly as can be: `samples` holds one tuple of numbers a packet."""

    def __init__(self, port: int, fields: Sequence[str], rate: float = 500.0) -> None:
        self.samples: list[tuple[float, ...]] = []
        self._socket = socket.create_connection(("127.0.0.1", port), 10.0)
        self._file = self._socket.makefile("rb")
        assert self._ask(b"V", struct.pack(">H", 2)) == b"\x01"
        types = self._ask(b"O", struct.pack(">d", rate) + ",".join(fields).encode())[1:].decode().split(",")
        self._layout = struct.Struct(">x" + "".join({"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i"}[t] for t in types))
        assert self._ask(b"S", b"") == b"\x01"
        threading.Thread(target=self._run, daemon=True).start()

    def _ask(self, kind: bytes, payload: bytes) -> bytes:
        self._socket.sendall(struct.pack(">Hc", 3 + len(payload), kind) + payload)
        answer, content = self._packet()
        assert answer == kind, (answer, content)
        return content

    def _packet(self) -> tuple[bytes, bytes]:
        size, kind = struct.unpack(">Hc", self._file.read(3))
        return kind, self._file.read(size - 3)

    def _run(self) -> None:
        try:
            while True:
                kind, content = self._packet()
                if kind == b"U":
                    self.samples.append(self._layout.unpack(content))
        except (OSError, ValueError, struct.error):
            return  # closed

    def close(self) -> None:
        """End the connection."""
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
