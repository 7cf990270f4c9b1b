"""What the emulator does with clients that send nonsense, ask without end or do not read."""

import random
import socket
import struct

import pytest

from .emulator_line import START, V2, V2_ACCEPTED, inputs, outputs, samples

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
