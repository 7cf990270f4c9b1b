"""Readers of a robot's stream that share no code with the driver."""

from __future__ import annotations

import itertools
import socket
import struct
import threading
from collections.abc import Hashable, Sequence
from contextlib import suppress

WAITS = "held back: stamp waits for the clock"  # value of the driver's report: samples that have no stamp


def assert_only_held_back(published: Sequence[Hashable], sent: Sequence[Hashable], held: int) -> list[int]:
    """All that was sent was published, in its order, but for as many as the driver says it held back.

    Returns the numbers of the samples that were published. One of the two may be read a bit further than the other.
    """
    number = {sample: k for k, sample in enumerate(sent)}
    last = max(k for k, sample in enumerate(published) if sample in number)
    numbers = [number[sample] for sample in published[: last + 1]]
    assert all(a < b for a, b in itertools.pairwise(numbers))
    assert numbers[-1] - numbers[0] + 1 - len(numbers) <= held
    return numbers


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
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

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
        """Take no more connections, and free the address: a thread that waits in `accept` would keep it."""
        with suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join(10.0)
