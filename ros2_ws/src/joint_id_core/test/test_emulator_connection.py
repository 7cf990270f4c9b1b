"""The emulator's side of RTDE, byte by byte: what is written here is taken from the protocol, not from our encoder."""

import random
import struct

import pytest

from joint_id_core.emulator.output import ticks_between

from .emulator_line import PAUSE, START, V2, V2_ACCEPTED, inputs, outputs, samples


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
