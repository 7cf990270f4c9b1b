"""A robot of RTDE that takes one connection and answers as the test wants it to."""

import queue
import socket
import struct
import threading

from joint_id_core.rtde.client import Request
from joint_id_core.rtde.socket_client import SocketClient

FIELDS = ("timestamp", "actual_q", "robot_mode")
TYPES = b"DOUBLE,VECTOR6D,INT32"
PATIENCE_S = 20.0  # a limit for tests that hang
SOON_S = 0.05  # in which nothing is expected to come


def packet(kind, payload=b""):
    return struct.pack(">HB", 3 + len(payload), ord(kind)) + payload


def sample(k, recipe=1):
    return packet("U", struct.pack(">B7di", recipe, 0.002 * k, *(k + 0.1 * j for j in range(6)), 7))


def values(k):
    return {"timestamp": 0.002 * k, "actual_q": tuple(k + 0.1 * j for j in range(6)), "robot_mode": 7}


def text(message):
    return packet("M", bytes([len(message)]) + message.encode() + b"\x04test\x03")


ANSWERS = {
    "V": packet("V", b"\x01"),
    "v": packet("v", struct.pack(">4I", 5, 13, 2, 99)),
    "O": packet("O", b"\x01" + TYPES),
    "S": packet("S", b"\x01"),
}


class Robot:
    """Takes one connection, checks what it is asked, and answers as it is told to; answers may be more than one packet.

    An answer of None is none at all, and b"" ends the connection.
    """

    def __init__(self, **answers):
        self.answers = ANSWERS | answers
        self.asked = []
        self.sock = None
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(PATIENCE_S)  # before the thread starts: a test may end at once
        self.port = self._listener.getsockname()[1]
        self._failures = queue.Queue()
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def _play(self):
        try:
            try:
                self.sock, _ = self._listener.accept()
            except OSError:
                raise EOFError from None
            self.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.sock.settimeout(PATIENCE_S)
            for kind, answer in self.answers.items():
                size, asked = struct.unpack(">HB", self._exactly(3))
                self.asked.append((chr(asked), self._exactly(size - 3)))
                assert chr(asked) == kind
                if answer == b"":
                    self.sock.close()
                elif answer is not None:
                    self.sock.sendall(answer)
        except EOFError:
            pass  # the client has seen enough
        except Exception as error:  # raised again in the test's own thread
            self._failures.put(error)

    def _exactly(self, size):
        data = b""
        while len(data) < size:
            try:
                more = self.sock.recv(size - len(data))
            except OSError:
                more = b""
            if not more:
                raise EOFError
            data += more
        return data

    def send(self, data):
        self.sock.sendall(data)

    def request(self, **changes):
        return Request(**({"host": "127.0.0.1", "fields": FIELDS, "port": self.port, "timeout": 5.0} | changes))

    def end(self):
        self._listener.shutdown(socket.SHUT_RDWR)  # nobody may have come
        self._listener.close()
        if self.sock is not None:
            self.sock.close()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        if not self._failures.empty():
            raise self._failures.get()


def playing():
    """For a fixture: start a robot, and open and start a client of it."""
    robots, clients = [], []

    def start(opened=True, request=None, **answers):
        robots.append(robot := Robot(**answers))
        clients.append(client := SocketClient(robot.request(**request or {})))
        if opened:
            client.open()
            client.start()
        return robot, client

    yield start
    for client in clients:
        client.close()
    for robot in robots:
        robot.end()


def in_background(call):
    """Run and return the thread and what it will have raised."""
    raised = []

    def run():
        try:
            call()
        except Exception as error:  # whatever it is, the test looks at it
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, raised
