"""The emulator as a process, and a client of it that knows only the framing of RTDE."""

import select
import socket
import struct
import subprocess
import sys
import time

import numpy as np

PATIENCE_S = 30.0  # a limit for tests that hang, not a measure of speed
FIELDS = "timestamp,actual_q,actual_qd,actual_current,robot_mode,safety_mode"
SAMPLE = struct.Struct(">B19d2i")
TIME, MODE, SAFETY = 1, 20, 21


class Emulator:
    """The process, its commands and its lines."""

    def __init__(self, log, *arguments):
        self._log = log
        with log.open("w") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-c", "from joint_id_core.cli import main; main()", "robot-emulator", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=file,
                bufsize=0,
            )
        self.ready = self.line()
        if self.ready:
            self.port = int(self.ready.rsplit(":", 1)[1])

    def line(self):
        """Next line of standard output."""
        assert select.select([self.process.stdout], [], [], PATIENCE_S)[0], f"it says nothing: {self.errors}"
        return self.process.stdout.readline().decode().rstrip("\n")

    def tell(self, command):
        """Give a command; return what is said of it."""
        self.give(command)
        return self.line()

    def give(self, command):
        """Give a command that is not answered."""
        self.process.stdin.write(f"{command}\n".encode())

    @property
    def errors(self):
        return self._log.read_text()

    def wait_for_error(self, text):
        end = time.monotonic() + PATIENCE_S
        while text not in self.errors:
            assert time.monotonic() < end, self.errors
            time.sleep(0.01)

    def end(self):
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()


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
