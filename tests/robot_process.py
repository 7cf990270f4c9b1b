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
from contextlib import suppress
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


class Connection:
    """A client that has agreed on the protocol, as plain as can be."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), 10.0)
        self._file = self._socket.makefile("rb")
        assert self.ask(b"V", struct.pack(">H", 2)) == b"\x01"

    def ask(self, kind: bytes, payload: bytes = b"") -> bytes:
        """Answer to a request."""
        self.send(kind, payload)
        answer, content = self.packet()
        assert answer == kind, (answer, content)
        return content

    def send(self, kind: bytes, payload: bytes) -> None:
        """A packet to the robot."""
        self._socket.sendall(struct.pack(">Hc", 3 + len(payload), kind) + payload)

    def packet(self) -> tuple[bytes, bytes]:
        """Kind and content of the next packet from the robot."""
        size, kind = struct.unpack(">Hc", self._file.read(3))
        return kind, self._file.read(size - 3)

    def close(self) -> None:
        """End the connection."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()


class Reader(Connection):
    """Reads doubles and vectors of six, beginning with `timestamp`: `samples` holds one tuple of numbers a packet."""

    def __init__(self, port: int, fields: Sequence[str]) -> None:
        super().__init__(port)
        self.samples: list[tuple[float, ...]] = []
        types = self.ask(b"O", struct.pack(">d", 500.0) + ",".join(("timestamp", *fields)).encode())[1:].decode()
        layout = struct.Struct(">x" + "".join({"DOUBLE": "d", "VECTOR6D": "6d"}[t] for t in types.split(",")))
        assert self.ask(b"S") == b"\x01"
        threading.Thread(target=self._run, args=(layout,), daemon=True).start()

    def _run(self, layout: struct.Struct) -> None:
        with suppress(OSError, ValueError, struct.error):  # closed, or what comes is not RTDE
            while True:
                kind, content = self.packet()
                if kind == b"U":
                    self.samples.append(layout.unpack(content))


class Wire:
    """Stands between one client and a robot, and notes the kinds of the packets that the client sends."""

    def __init__(self, host: str, port: int, robot_port: int) -> None:
        self.kinds: list[bytes] = []
        self._robot_port = robot_port
        self._server = socket.create_server((host, port))
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        with suppress(OSError):  # closed
            while True:
                client, _ = self._server.accept()
                robot = socket.create_connection(("127.0.0.1", self._robot_port))
                for source, sink, note in ((client, robot, True), (robot, client, False)):
                    threading.Thread(target=self._pass_on, args=(source, sink, note), daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket, note: bool) -> None:
        rest = b""
        with suppress(OSError):
            while data := source.recv(65536):
                sink.sendall(data)
                rest = rest + data if note else b""
                while len(rest) >= 3:
                    size, kind = struct.unpack_from(">Hc", rest)
                    if len(rest) < size:
                        break
                    self.kinds.append(kind)
                    rest = rest[size:]
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Take no more connections."""
        self._server.close()
