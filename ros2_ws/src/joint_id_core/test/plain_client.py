"""A client of the emulator that knows only the framing of RTDE."""

import socket
import struct

import numpy as np

PATIENCE_S = 30.0  # a limit for tests that hang, not a measure of speed
FIELDS = "timestamp,actual_q,actual_qd,actual_current,robot_mode,safety_mode"
SAMPLE = struct.Struct(">B19d2i")
TIME, MODE, SAFETY = 1, 20, 21


class Client:
    """A reader of RTDE that knows only its framing."""

    def __init__(self, port, patience=PATIENCE_S):
        self.socket = socket.create_connection(("127.0.0.1", port), patience)

    def send(self, kind, payload=b""):
        self.socket.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def exactly(self, count):
        got = b""
        while len(got) < count:
            part = self.socket.recv(count - len(got))
            if not part:
                raise EOFError
            got += part
        return got

    def packet(self):
        size, kind = struct.unpack(">HB", self.exactly(3))
        return chr(kind), self.exactly(size - 3)

    def ask(self, kind, payload=b""):
        self.send(kind, payload)
        answered, answer = self.packet()
        assert answered == kind
        return answer

    def start(self, hertz=500.0, fields=FIELDS):
        assert self.ask("V", b"\x00\x02") == b"\x01"
        self.types = self.ask("O", struct.pack(">d", hertz) + fields.encode())
        assert self.ask("S") == b"\x01"
        return self

    def samples(self, count):
        """Rows of the next data packets, shape (count, 22): recipe and the fields."""
        rows = []
        while len(rows) < count:
            kind, payload = self.packet()
            assert kind == "U"
            rows.append(SAMPLE.unpack(payload))
        return np.array(rows)

    def samples_until(self, wanted, most=20000):
        """All rows up to the first for which `wanted` holds."""
        rows = []
        for _ in range(most):
            rows.append(self.samples(1)[0])
            if wanted(rows[-1]):
                return np.array(rows)
        raise AssertionError("it never came")


def steps_of(rows):
    """Steps of the controller's clock, in samples of 500 Hz."""
    return np.round(np.diff(rows[:, TIME]) * 500.0, 6)
