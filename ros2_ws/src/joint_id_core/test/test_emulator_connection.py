"""The emulator's side of RTDE, byte by byte: what is written here is taken from the protocol, not from our encoder."""

import random
import socket
import struct

import pytest

from joint_id_core.emulator.connection import Connection
from joint_id_core.emulator.controller import Controller
from joint_id_core.emulator.output import ticks_between
from joint_id_core.emulator.robots import build_joints

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


@pytest.fixture
def controller():
    return Controller(build_joints("ur3e"), (), 0.0, (5, 13, 2, 77), ("joint_mode",))


@pytest.fixture
def open_line(controller):
    held, lines = {}, []

    def call():
        lines.append(Line(controller, held))
        return lines[-1]

    yield call
    for line in lines:
        line.client.close()
        line.connection.close()


@pytest.fixture
def line(open_line):
    return open_line()


def test_the_handshake_as_the_protocol_has_it(line):
    assert line.ask(b"\x00\x05V\x00\x01") == b"\x00\x04V\x00"
    assert line.ask(V2) == V2_ACCEPTED
    assert line.ask(b"\x00\x03v") == b"\x00\x13v\x00\x00\x00\x05\x00\x00\x00\x0d\x00\x00\x00\x02\x00\x00\x00\x4d"
    assert line.ask(outputs("timestamp,robot_mode", 500.0)) == b"\x00\x10O\x01DOUBLE,INT32"
    assert line.tick() == b""
    assert line.ask(START) == b"\x00\x04S\x01"
    # 8 bytes of 0.002 s, 4 bytes of mode 7
    assert line.tick() == b"\x00\x10U\x01" + struct.pack(">d", 0.002) + b"\x00\x00\x00\x07"
    assert line.ask(PAUSE) == b"\x00\x04P\x01"
    assert line.tick() == b""
    assert line.ask(START) == b"\x00\x04S\x01"
    assert line.tick()[4:12] == struct.pack(">d", 0.006)


def test_requests_in_one_piece_or_byte_by_byte_are_the_same(open_line):
    request = V2 + b"\x00\x03v" + outputs("timestamp", 125.0) + START
    whole, slow = open_line(), open_line()
    answer = whole.ask(request)
    assert answer == b"".join(slow.ask(request[k : k + 1]) for k in range(len(request)))
    assert answer.endswith(b"\x00\x0aO\x01DOUBLE\x00\x04S\x01")


def test_the_answer_to_start_comes_before_the_first_sample(line):
    line.ask(V2 + outputs("timestamp", 500.0))
    line.client.sendall(START)
    line.connection.receive(line.now)
    assert line.tick()[:7] == b"\x00\x04S\x01\x00\x0cU"


def test_a_comma_at_the_end_is_let_pass(line):
    assert line.ask(V2 + outputs("timestamp,actual_q,", 500.0)) == V2_ACCEPTED + b"\x00\x13O\x01DOUBLE,VECTOR6D"


@pytest.mark.parametrize("name", ["bogus", "actual_current_as_torque", "joint_mode", "output_double_register_48"])
def test_a_field_that_is_not_there_is_named_and_start_is_refused(line, name):
    answer = line.ask(V2 + outputs(f"timestamp,{name}", 500.0))
    assert answer == V2_ACCEPTED + b"\x00\x14O\x00DOUBLE,NOT_FOUND"
    assert line.ask(START) == b"\x00\x04S\x00"
    assert line.tick() == b""
    assert line.ask(outputs("timestamp", 500.0) + START) == b"\x00\x0aO\x01DOUBLE\x00\x04S\x01"


def test_start_is_refused_after_a_recipe_was_even_if_there_is_a_good_one(line):
    line.ask(V2 + outputs("timestamp", 500.0))
    assert line.ask(outputs("bogus", 500.0) + START) == b"\x00\x0dO\x00NOT_FOUND\x00\x04S\x00"
    assert line.tick() == b""


def test_start_without_a_recipe_is_refused(line):
    assert line.ask(V2 + START) == V2_ACCEPTED + b"\x00\x04S\x00"


def test_several_recipes_each_at_its_own_rate(line):
    line.ask(V2)
    assert line.ask(outputs("timestamp", 500.0)) == b"\x00\x0aO\x01DOUBLE"
    assert line.ask(outputs("safety_mode,robot_mode", 125.0)) == b"\x00\x0fO\x02INT32,INT32"
    line.ask(START)
    got = [line.tick() for _ in range(8)]
    assert [len(g) for g in got] == [24, 12, 12, 12, 24, 12, 12, 12]
    assert got[4][:4] == b"\x00\x0cU\x01"
    assert got[4][12:] == b"\x00\x0cU\x02\x00\x00\x00\x01\x00\x00\x00\x07"


@pytest.mark.parametrize(
    ("asked", "version", "ticks"),
    [
        (500.0, (5, 13), 1),
        (250.0, (5, 13), 2),
        (125.0, (5, 13), 4),
        (100.0, (5, 13), 5),
        (300.0, (5, 13), 1),
        (200.0, (5, 13), 2),
        (1.0, (5, 13), 500),
        (1000.0, (10, 11), 1),
        (500.0, (3, 15), 4),
        (125.0, (3, 15), 4),
        (60.0, (3, 15), 8),
    ],
)
def test_the_rate_is_the_largest_one_divided_by_a_whole_number(asked, version, ticks):
    assert ticks_between(asked, version) == ticks


def test_inputs_can_be_written_by_one_client_and_read_by_another(open_line):
    writer, reader = open_line(), open_line()
    names = "input_double_register_24,input_int_register_3"
    assert writer.ask(V2 + inputs(names)) == V2_ACCEPTED + b"\x00\x10I\x01DOUBLE,INT32"
    reader.ask(V2 + outputs(names, 500.0) + START)
    assert writer.ask(b"\x00\x10U\x01" + struct.pack(">di", 2.5, -7)) == b""
    assert reader.tick() == b"\x00\x10U\x01" + struct.pack(">di", 2.5, -7)
    assert writer.ask(START) == b"\x00\x04S\x01"
    assert writer.tick() == b""


def test_inputs_that_another_client_holds_are_in_use_until_it_goes(open_line):
    first, second = open_line(), open_line()
    assert first.ask(V2 + inputs("input_int_register_24")).endswith(b"I\x01INT32")
    assert first.ask(inputs("input_int_register_24,input_int_register_25")).endswith(b"I\x02INT32,INT32")
    wanted = inputs("input_int_register_26,input_int_register_24")
    assert second.ask(V2 + wanted).endswith(b"I\x00INT32,IN_USE")
    assert second.ask(inputs("bogus,actual_q")).endswith(b"I\x00NOT_FOUND,NOT_FOUND")
    # What was refused is not held.
    assert first.ask(inputs("input_int_register_26")).endswith(b"I\x03INT32")
    first.client.close()
    first.connection.receive(0.0)
    assert first.connection.closed
    assert second.ask(wanted).endswith(b"I\x01INT32,INT32")


def test_a_text_message_of_a_client_is_shown(line, capsys):
    assert line.ask(V2 + b"\x00\x0fM\x05hello\x04test\x03") == V2_ACCEPTED
    assert capsys.readouterr().err == "robot-emulator: client says 'hello'\n"


BAD_REQUESTS = {
    "not RTDE": (b"GET / HTTP/1.1\r\n\r\n", "a packet of kind 84"),
    "size below a header": (b"\x00\x02V", "not RTDE"),
    "unknown kind": (b"\x00\x03X", "not RTDE"),
    "version of one byte": (b"\x00\x04V\x02", "protocol version with 1 bytes: it has 2"),
    "outputs before the version": (outputs("timestamp", 500.0), "before protocol version 2 was agreed"),
    "start before the version": (START, "before protocol version 2 was agreed"),
    "outputs without a frequency": (V2 + b"\x00\x06Oabc", "begins with the frequency"),
    "frequency zero": (V2 + outputs("timestamp", 0.0), "0.0 Hz"),
    "negative frequency": (V2 + outputs("timestamp", -125.0), "-125.0 Hz"),
    "frequency NaN": (V2 + outputs("timestamp", float("nan")), "nan Hz"),
    "frequency infinite": (V2 + outputs("timestamp", float("inf")), "inf Hz"),
    "no names": (V2 + outputs("", 500.0), "an empty name"),
    "two commas": (V2 + outputs("timestamp,,actual_q", 500.0), "an empty name"),
    "a name twice": (V2 + outputs("actual_q,timestamp,actual_q", 500.0), "field actual_q is asked for twice"),
    "bytes for names": (V2 + b"\x00\x0dO" + bytes(8) + b"\xff\xfe", "0.0 Hz"),
    "names that are not ASCII": (V2 + b"\x00\x0dO" + struct.pack(">d", 500.0) + b"\xff\xfe", "not ASCII"),
    "no names of inputs": (V2 + inputs(""), "an empty name"),
    "data of no recipe": (V2 + b"\x00\x03U", "recipe 0, which was not set up"),
    "data of an unknown recipe": (V2 + b"\x00\x08U\x05abcd", "recipe 5, which was not set up"),
    "data of another size": (V2 + inputs("input_int_register_24") + b"\x00\x06U\x01ab", "recipe 1 has 5 bytes"),
    "empty text message": (V2 + b"\x00\x03M", "text message of 0 characters"),
    "text that ends early": (V2 + b"\x00\x07M\xffabc", "text message of 255 characters"),
}


@pytest.mark.parametrize("request_", BAD_REQUESTS.values(), ids=BAD_REQUESTS)
def test_a_request_that_makes_no_sense_ends_that_connection_with_a_text(open_line, request_, capsys):
    data, says = request_
    good, bad = open_line(), open_line()
    good.ask(V2 + outputs("timestamp", 500.0) + START)
    answer = bad.ask(data)
    at = answer.rindex(b"robot-emulator") - 1
    assert answer[at:] == b"\x0erobot-emulator\x01"  # source, level error
    start = answer.index(b"M", len(V2_ACCEPTED) if data.startswith(V2) else 0)
    length = answer[start + 1]
    message = answer[start + 2 : start + 2 + length]
    assert start + 2 + length == at
    assert says in message.decode()
    assert answer[start - 2 : start] == struct.pack(">H", len(answer) - start + 2)
    assert says in capsys.readouterr().err
    assert bad.client.recv(10) == b""  # the end
    assert not bad.connection.closed  # so that what the client still sends does not reset the line
    bad.client.sendall(V2)
    bad.connection.receive(bad.now)
    assert bad.read() == b""
    bad.now += 1.1
    bad.connection.flush(bad.now)
    assert bad.connection.closed
    assert len(good.tick()) == 12


def test_random_requests_never_do_more_than_end_their_connection(open_line):
    random_ = random.Random(0)
    kinds = b"VvMUOISP"
    for _ in range(300):
        line = open_line()
        line.ask(V2)
        for _ in range(5):
            body = random_.randbytes(random_.randint(0, 30))
            if line.connection.closed:
                break
            try:
                line.ask(struct.pack(">HB", 3 + len(body), random_.choice(kinds)) + body)
            except BrokenPipeError:
                break
            line.tick()
        line.client.close()
        line.connection.close()


def samples(data):
    """Timestamps of whole data packets of one DOUBLE; fails where one is cut."""
    assert len(data) % 12 == 0
    assert all(data[k : k + 4] == b"\x00\x0cU\x01" for k in range(0, len(data), 12))
    return [struct.unpack_from(">d", data, k + 4)[0] for k in range(0, len(data), 12)]


def flood(line, most=20000):
    """Publish without the client reading until the line is full; return how many samples that took."""
    for k in range(most):
        line.connection.publish(k)
        line.connection.flush(line.now)
        if line.connection._blocked_since is not None:
            return k
    raise AssertionError("the line never fills")


def test_a_client_that_does_not_read_loses_whole_samples(line):
    line.client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line.ask(V2 + outputs("timestamp", 500.0) + START)
    line.controller.report()
    sent = flood(line)
    for k in range(3000):
        line.connection.publish(k)
        line.connection.flush(line.now)
    got = line.read()
    line.connection.flush(line.now)
    got += line.read()
    assert abs(len(samples(got)) - sent) <= 2
    line.connection.flush(line.now)
    assert len(samples(line.tick())) == 1


def test_a_client_that_never_reads_is_cut_off_after_ten_seconds(line, capsys):
    line.ask(V2 + outputs("timestamp", 500.0) + START)
    line.controller.report()
    line.now = 100.0
    flood(line)
    for line.now in (100.5, 105.0, 109.9):
        line.connection.flush(line.now)
        assert not line.connection.closed
    line.connection.flush(110.1)
    assert line.connection.closed
    assert "client is cut off: it has not read for 10 s" in capsys.readouterr().err


def test_a_client_that_asks_without_end_and_reads_nothing_is_cut_off(line):
    line.ask(V2)
    for _ in range(100):
        line.client.setblocking(True)
        line.client.sendall(b"\x00\x03v" * 400)
        line.connection.receive(line.now)
    line.connection.flush(line.now)
    assert b"nobody reads the answers" in line.read()


def test_fragments_carry_the_same_bytes_in_other_pieces(line):
    line.ask(V2 + outputs("timestamp", 500.0) + START)
    pieces = random.Random(1)
    parts = [line.tick(pieces) for _ in range(200)]
    parts.append(line.tick())
    got = samples(b"".join(parts))
    assert got == [k * 0.002 for k in range(len(got))]
    assert len(got) == 201
    assert sum(len(p) % 12 != 0 for p in parts) > 20
    assert sum(len(p) > 12 for p in parts) > 20


def test_spoilt_samples(line):
    line.ask(V2 + outputs("timestamp,actual_q,robot_mode", 500.0) + START)
    (output,) = line.connection.outputs
    packet = struct.Struct(">HBB7di")
    output.drop, first = 2, [line.tick() for _ in range(3)]
    assert [len(p) for p in first] == [packet.size] * 3
    dropped = [line.tick() for _ in range(3)]
    assert [len(p) for p in dropped] == [0, 0, packet.size]
    output.zero = 1
    assert packet.unpack(line.tick())[3:] == (0.0,) * 8
    assert packet.unpack(line.tick())[-1] == 7
    output.nan = 1
    values = packet.unpack(line.tick())
    assert all(v != v for v in values[4:10])
    assert (values[3], values[-1]) == (8 * 0.002, 7)
    assert all(v == v for v in packet.unpack(line.tick()))
