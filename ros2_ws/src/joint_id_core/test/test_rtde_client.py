"""Our client against a scripted robot: what it asks, what it takes, and what it says of robots that are not well."""

import queue
import socket
import struct
import threading
import time
from contextlib import suppress

import pytest

from joint_id_core.errors import JointIdError
from joint_id_core.rtde.client import Request
from joint_id_core.rtde.errors import ProtocolError, RefusedError, UnreachableError
from joint_id_core.rtde.rates import sent_rate
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
        self.port = self._listener.getsockname()[1]
        self._failures = queue.Queue()
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def _play(self):
        self._listener.settimeout(PATIENCE_S)
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
        except Exception as error:
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


@pytest.fixture
def play():
    """Start a robot, and open and start a client of it."""
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


def read_all(client, count):
    """So many samples, or what came until the patience ended."""
    samples, end = [], time.monotonic() + PATIENCE_S
    while len(samples) < count and time.monotonic() < end:
        samples += client.read(1.0)
    return samples


def test_asks_for_what_is_wanted_and_reads_it(play):
    robot, client = play()
    assert client.version == (5, 13, 2, 99)
    fields = struct.pack(">d", 500.0) + b"timestamp,actual_q,robot_mode"
    assert robot.asked == [("V", b"\x00\x02"), ("v", b""), ("O", fields), ("S", b"")]
    before = time.time_ns()
    robot.send(sample(1) + sample(2))
    samples = read_all(client, 2)
    assert [s.values for s in samples] == [values(1), values(2)]
    assert all(before <= s.received_ns <= time.time_ns() for s in samples)
    assert client.read(SOON_S) == []
    assert client.read(0.0) == []


def test_samples_that_come_with_the_answer_to_start_are_kept(play):
    robot, client = play(S=packet("S", b"\x01") + sample(1) + sample(2)[:20])
    robot.send(sample(2)[20:])
    assert [s.values for s in read_all(client, 2)] == [values(1), values(2)]


def test_samples_cut_at_every_byte(play):
    robot, client = play()
    whole = sample(1) + text("hello") + sample(2)
    for at in range(1, len(whole)):
        robot.send(whole[:at])
        got = read_all(client, 1) if at >= len(sample(1)) else []
        assert [s.values for s in got] == ([values(1)] if got else [])
        robot.send(whole[at:])
        got += read_all(client, 2 - len(got))
        assert [s.values for s in got] == [values(1), values(2)], at
        assert client.messages.popleft() == "hello"


def test_a_thousand_samples_that_waited_come_in_order(play):
    robot, client = play()
    sender = threading.Thread(target=robot.send, args=(b"".join(map(sample, range(1000))),))
    sender.start()
    samples = read_all(client, 1000)
    sender.join(PATIENCE_S)
    assert [s.values for s in samples] == [values(k) for k in range(1000)]


def test_texts_may_come_at_any_time(play):
    answers = {kind: text(f"before {kind}") + answer for kind, answer in ANSWERS.items()}
    robot, client = play(**answers)
    robot.send(text("two\nlines") + sample(1) + text("at the end"))
    assert [s.values for s in read_all(client, 1)] == [values(1)]
    assert client.read(SOON_S) == []
    expected = ["before V", "before v", "before O", "before S", "two lines", "at the end"]
    assert list(client.messages) == expected


@pytest.mark.parametrize("kind", ANSWERS)
def test_a_robot_that_falls_mute_is_told_within_the_timeout(play, kind):
    _, client = play(opened=False, request={"timeout": 0.2}, **{kind: text("busy") + packet(kind, b"\x01")[:3]})
    with pytest.raises(UnreachableError, match=r"is connected but gives no answer on .* within 0.2 s: check that"):
        client.open()
        client.start()


def test_texts_without_end_are_no_answer(play):
    robot, client = play(opened=False, request={"timeout": 0.3}, V=None)
    done = threading.Event()

    def talk():
        while not done.is_set():
            with suppress(OSError, AttributeError):  # not connected yet, or no more
                robot.send(text("wait"))
            time.sleep(0.01)

    talker = threading.Thread(target=talk)
    talker.start()
    with pytest.raises(UnreachableError, match=r"no answer on the protocol version within 0\.3 s"):
        client.open()
    done.set()
    talker.join(PATIENCE_S)


def test_texts_without_end_are_no_samples(play):
    robot, client = play()
    robot.send(text("x" * 200) * 100)
    assert client.read(SOON_S) == []
    assert 0 < len(client.messages) <= 100


def test_a_port_where_nobody_listens():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(UnreachableError, match=f"robot 127.0.0.1:{port}: refuses the connection: check that"):
        SocketClient(Request("127.0.0.1", FIELDS, port=port)).open()


@pytest.mark.parametrize("host", ["robot..local", "x" * 70, "no-such-robot.invalid"])
def test_a_host_that_is_not_known(host):
    with pytest.raises(UnreachableError, match=f"host '{host}' is not known: .*: check the robot's name or address"):
        SocketClient(Request(host, FIELDS)).open()


@pytest.fixture
def full():
    """Port of a server that takes no more connections: to connect there waits."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(0)
        waiting = [socket.socket() for _ in range(4)]
        for sock in waiting:
            sock.setblocking(False)
            sock.connect_ex(server.getsockname())
        yield server.getsockname()[1]
        for sock in waiting:
            sock.close()


def test_a_host_that_does_not_answer_at_all(full):
    with pytest.raises(UnreachableError, match=r"no answer within 0\.2 s: check address, cable"):
        SocketClient(Request("127.0.0.1", FIELDS, port=full, timeout=0.2)).open()


@pytest.mark.parametrize(
    "greeting",
    [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"SSH-2.0-OpenSSH_9.6\r\n", b"\x00\x00\x05\x60\x10" + bytes(1371)],
)
def test_a_server_that_is_not_rtde(play, greeting):
    _, client = play(opened=False, V=greeting)
    with pytest.raises(ProtocolError, match=r"robot 127\.0\.0\.1:.*: not RTDE: .*: check that the port is the"):
        client.open()


@pytest.mark.parametrize(
    ("answers", "error", "message"),
    [
        ({"V": packet("V", b"\x00")}, RefusedError, "does not speak version 2 of RTDE: update the controller"),
        ({"V": b""}, UnreachableError, "the robot ended the connection"),
        ({"V": packet("V")}, ProtocolError, "packet of kind 'V' in place of the answer on the protocol version"),
        ({"V": packet("v", bytes(16))}, ProtocolError, "packet of kind 'v' in place of the answer on the protocol ver"),
        ({"v": packet("v", bytes(12))}, ProtocolError, "a controller version of 12 bytes: it has 16"),
        ({"O": packet("O", b"\x01DOUBLE,VECTOR6D")}, ProtocolError, "2 types for 3 fields"),
        ({"O": packet("O", b"\x01DOUBLE,VECTOR6D,COMPLEX")}, ProtocolError, "sends robot_mode as 'COMPLEX': a type"),
        ({"O": packet("O", b"\x01DOUBLE,VECTOR6D,\xff")}, ProtocolError, "a type that is not known"),
        ({"S": packet("S", b"\x00")}, RefusedError, "does not start its stream: restart the robot's controller"),
        ({"S": text("Too busy") + packet("S", b"\x00")}, RefusedError, r"its stream \(it says: Too busy\): restart"),
        ({"S": sample(1)}, ProtocolError, "packet of kind 'U' in place of the answer on START"),
    ],
)
def test_answers_that_do_not_fit(play, answers, error, message):
    _, client = play(opened=False, **answers)
    with pytest.raises(error, match=message):
        client.open()
        client.start()


def test_fields_that_the_controller_lacks_are_named_with_their_history(play):
    _, client = play(
        opened=False,
        request={"fields": ("timestamp", "actual_current_as_torque", "actual_qdd")},
        O=packet("O", b"\x00DOUBLE,NOT_FOUND,NOT_FOUND"),
    )
    expected = (
        r"has version 5.13.2 and no field actual_current_as_torque \(which came with 5.23 and 10.11\), actual_qdd: "
    )
    with pytest.raises(RefusedError, match=expected):
        client.open()


@pytest.mark.parametrize(
    ("rate", "major", "message"),
    [
        (1000.0, 5, "rate 1000 Hz: a controller of version 5 sends at 500 Hz over a whole number: choose 500"),
        (300.0, 5, "choose 500 or 250"),
        (120.0, 5, "choose 125 or 100"),
        (500.0, 3, "a controller of version 3 sends at 125 Hz over a whole number: choose 125"),
        (100.0, 3, "choose 125 or 62.5"),
    ],
)
def test_rates_that_the_controller_does_not_send_at(play, rate, major, message):
    version = packet("v", struct.pack(">4I", major, 15, 0, 0))
    _, client = play(opened=False, request={"rate": rate}, v=version)
    with pytest.raises(RefusedError, match=message):
        client.open()


def test_every_possible_rate_is_asked_for_such_that_the_controller_divides_it_right():
    for largest, version in ((500.0, (5, 13, 0, 0)), (500.0, (10, 11, 0, 0)), (125.0, (3, 15, 0, 0))):
        for every in range(1, 501):
            rate = largest / every
            for asked in (rate, float(f"{rate:.5g}")):
                sent = sent_rate(asked, version)
                assert sent == pytest.approx(rate, rel=1e-12)
                assert int(largest / sent) == every


def test_a_connection_cut_in_the_middle_of_a_sample(play):
    robot, client = play()
    robot.send(sample(1) + sample(2)[:30])
    assert [s.values for s in read_all(client, 1)] == [values(1)]
    robot.sock.close()
    with pytest.raises(UnreachableError, match="the robot ended the connection"):
        read_all(client, 1)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (sample(9, recipe=2), "data packet of recipe 2, 61 bytes: recipe 1 has 61 bytes"),
        (packet("U", b"\x01" + bytes(59)), "data packet of recipe 1, 60 bytes: recipe 1 has 61 bytes"),
        (packet("U"), "data packet of nothing"),
        (packet("S", b"\x01"), "packet of kind 'S' among the samples"),
        (b"\x00\x01U", "not RTDE: a packet of kind 85 and 1 bytes"),
    ],
)
def test_a_bad_packet_is_told_after_the_samples_before_it(play, bad, message):
    robot, client = play()
    robot.send(sample(1) + sample(2) + bad + sample(3))
    assert [s.values for s in read_all(client, 2)] == [values(1), values(2)]
    for _ in range(2):
        with pytest.raises(ProtocolError, match=f"robot 127.0.0.1:.*{message}"):
            read_all(client, 1)


def in_background(call):
    """Run and return the thread and what it will have raised."""
    raised = []

    def run():
        try:
            call()
        except Exception as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, raised


def test_closing_ends_a_read_under_way(play):
    _, client = play()
    thread, raised = in_background(lambda: client.read(10.0 * PATIENCE_S))
    time.sleep(SOON_S)
    client.close()
    client.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert [str(e).rpartition(": ")[2] for e in raised] == ["the connection is closed on this side"]
    with pytest.raises(UnreachableError, match="closed on this side"):
        client.read(0.0)


def test_closing_ends_a_handshake_under_way(play):
    _, client = play(opened=False, request={"timeout": 10.0 * PATIENCE_S}, v=None)
    thread, raised = in_background(client.open)
    time.sleep(SOON_S)
    client.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert "closed on this side" in str(raised[0])


def test_closing_ends_a_connection_attempt_under_way(full):
    client = SocketClient(Request("127.0.0.1", FIELDS, port=full, timeout=10.0 * PATIENCE_S))
    thread, raised = in_background(client.open)
    time.sleep(SOON_S)
    client.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert isinstance(raised[0], UnreachableError) and "closed on this side" in str(raised[0])


def test_a_closed_client_does_not_open(play):
    _, client = play(opened=False)
    client.close()
    with pytest.raises(UnreachableError, match="closed on this side"):
        client.open()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"host": " "}, "host of the robot is empty"),
        ({"port": 0}, r"port 0: must be in \[1, 65535\]"),
        ({"port": 65536}, "port 65536"),
        ({"fields": ("actual_q",)}, "field timestamp is not asked for"),
        ({"fields": ("timestamp", "actual_q", "actual_q")}, "field actual_q is asked for twice"),
        ({"fields": ("timestamp", "actual_q,actual_qd")}, "field 'actual_q,actual_qd': a field's name has letters"),
        ({"fields": ("timestamp", "")}, "field '': a field's name"),
        ({"rate": 0.0}, "rate = 0.0: must be positive"),
        ({"rate": float("nan")}, "rate = nan"),
        ({"timeout": float("inf")}, "timeout = inf"),
    ],
)
def test_requests_that_no_robot_can_fulfil(changes, message):
    with pytest.raises(JointIdError, match=message):
        Request(**({"host": "127.0.0.1", "fields": FIELDS} | changes))
