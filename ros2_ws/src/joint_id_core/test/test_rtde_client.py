"""Our client against a scripted robot: what it asks, what it takes, and what it says of samples that are none."""

import struct
import threading
import time

import pytest

from joint_id_core.rtde.errors import ProtocolError, UnreachableError

from .scripted_robot import (
    ANSWERS,
    PATIENCE_S,
    SOON_S,
    in_background,
    packet,
    playing,
    sample,
    text,
    values,
)

play = pytest.fixture(playing)


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


def test_texts_without_end_are_no_samples(play):
    robot, client = play()
    robot.send(text("x" * 200) * 100)
    assert client.read(SOON_S) == []
    assert 0 < len(client.messages) <= 100


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
