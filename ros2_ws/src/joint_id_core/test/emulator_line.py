"""A connection of the emulator, whose client and clock a test holds."""

import socket
import struct

from joint_id_core.emulator.connection import Connection

V2 = b"\x00\x05V\x00\x02"  # 5 bytes, V, version 2
V2_ACCEPTED = b"\x00\x04V\x01"
START, PAUSE = b"\x00\x03S", b"\x00\x03P"


def outputs(names, hertz):
    body = struct.pack(">d", hertz) + names.encode()
    return struct.pack(">HB", 3 + len(body), ord("O")) + body


def inputs(names):
    return struct.pack(">HB", 3 + len(names), ord("I")) + names.encode()


class Line:
    """A connection of the emulator with a client at its other end, and the clock in our hands."""

    def __init__(self, controller, held):
        self.controller = controller
        self.client, there = socket.socketpair()
        self.connection = Connection(there, "client", controller, held)
        self.client.settimeout(5.0)
        self.now = 0.0

    def ask(self, data):
        """Send a request; return all that comes back at once."""
        self.client.sendall(data)
        self.connection.receive(self.now)
        self.connection.flush(self.now)
        return self.read()

    def read(self):
        """All bytes that have arrived."""
        self.client.setblocking(False)
        got = b""
        try:
            while part := self.client.recv(65536):
                got += part
        except BlockingIOError:
            pass
        return got

    def tick(self, pieces=None):
        """One sample; return what arrives."""
        self.controller.tick()
        self.controller.report()
        self.connection.publish(self.controller.ticks)
        self.connection.flush(self.now, pieces)
        self.controller.advance()
        self.now += 0.002
        return self.read()


def samples(data):
    """Timestamps of whole data packets of one DOUBLE; fails where one is cut."""
    assert len(data) % 12 == 0
    assert all(data[k : k + 4] == b"\x00\x0cU\x01" for k in range(0, len(data), 12))
    return [struct.unpack_from(">d", data, k + 4)[0] for k in range(0, len(data), 12)]
