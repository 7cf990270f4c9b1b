"""Our client until a scripted robot streams: what it says of hosts, robots and answers that are not well."""

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

from .scripted_robot import ANSWERS, FIELDS, PATIENCE_S, SOON_S, in_background, packet, playing, sample, text

play = pytest.fixture(playing)


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
