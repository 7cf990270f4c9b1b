"""Packets come out as they went in, however the stream was cut; what was not sent as a sample never becomes one."""

import itertools
import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from joint_id_core.rtde import packets
from joint_id_core.rtde.errors import ProtocolError
from joint_id_core.rtde.fields import FIELDS, TYPES, register_type
from joint_id_core.rtde.packets import KINDS, PacketReader, Recipe, encode

PACKETS = st.lists(st.tuples(st.sampled_from(sorted(KINDS)), st.binary(max_size=40)), max_size=8)
SIX = tuple(0.5 * k for k in range(6))


def fed(reader, *pieces):
    return [tuple(packet) for piece in pieces for packet in reader.feed(piece)]


def cut(data, places):
    edges = [0, *sorted(places), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


def test_a_packet_on_the_wire():
    assert encode(packets.REQUEST_VERSION, b"\x00\x02") == b"\x00\x05V\x00\x02"
    assert encode(packets.START) == b"\x00\x03S"


@settings(deadline=None)
@given(PACKETS, st.data())
def test_the_same_packets_however_they_are_split_and_glued(sent, data):
    stream = b"".join(encode(*packet) for packet in sent)
    places = data.draw(st.lists(st.integers(0, len(stream))))
    assert fed(PacketReader(), *cut(stream, places)) == sent


@settings(deadline=None)
@given(PACKETS)
def test_the_same_packets_byte_by_byte(sent):
    stream = b"".join(encode(*packet) for packet in sent)
    assert fed(PacketReader(), *(bytes([b]) for b in stream)) == sent


def test_the_longest_packet():
    sent = (packets.DATA, bytes(range(256)) * 255 + bytes(252))
    assert len(encode(*sent)) == 65535
    assert fed(PacketReader(), *cut(encode(*sent), [1, 3, 40000])) == [sent]


@pytest.mark.parametrize("bad", [b"\x00\x00U", b"\x00\x02U", b"\x00\x03?", b"HTTP/1.1 400", b"\xff\xff\x00"])
def test_what_is_no_packet_is_told_after_the_packets_before_it_and_for_ever(bad):
    reader = PacketReader()
    got = []
    with pytest.raises(ProtocolError, match=r"not RTDE: a packet of kind \d+ and \d+ bytes \(known kinds: \[73, 77"):
        got.extend(reader.feed(encode(packets.DATA, b"abc") + bad + encode(packets.DATA, b"def")))
    assert got == [(packets.DATA, b"abc")]
    for more in (b"", encode(packets.DATA, b"ghi")):
        with pytest.raises(ProtocolError):
            fed(reader, more)


@settings(deadline=None)
@given(st.binary(max_size=400), st.data())
def test_garbage_is_refused_or_waited_on_and_cutting_it_changes_nothing(garbage, data):
    """What comes out is what stands in the bytes, read independently here."""
    expected, at, broken = [], 0, False
    while len(garbage) - at >= 3:
        size, kind = struct.unpack(">HB", garbage[at : at + 3])
        if size < 3 or kind not in b"VvMUOISP":
            broken = True
            break
        if len(garbage) - at < size:
            break
        expected.append((kind, garbage[at + 3 : at + size]))
        at += size
    reader, got, refused = PacketReader(), [], False
    try:
        for piece in cut(garbage, data.draw(st.lists(st.integers(0, len(garbage)), max_size=5))):
            for packet in reader.feed(piece):
                got.append(tuple(packet))
    except ProtocolError:
        refused = True
    assert (got, refused) == (expected, broken)


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_garbage_never_becomes_a_sample_of_another_recipe_or_size(garbage):
    recipe = Recipe(1, {"timestamp": "DOUBLE", "robot_mode": "INT32"})
    try:
        values = recipe.unpack(garbage)
    except ProtocolError:
        assert len(garbage) != 13 or garbage[0] != 1
    else:
        assert len(garbage) == 13 and garbage[0] == 1
        packed = recipe.pack(values)
        assert packed == garbage or math.isnan(values["timestamp"])


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (b"", "data packet of nothing: recipe 3 has 9 bytes"),
        (b"\x03" + bytes(7), "data packet of recipe 3, 8 bytes: recipe 3 has 9 bytes"),
        (b"\x03" + bytes(9), "data packet of recipe 3, 10 bytes: recipe 3 has 9 bytes"),
        (b"\x02" + bytes(8), "data packet of recipe 2, 9 bytes: recipe 3 has 9 bytes"),
    ],
)
def test_another_recipe_or_size_is_refused(payload, message):
    with pytest.raises(ProtocolError, match=message):
        Recipe(3, {"timestamp": "DOUBLE"}).unpack(payload)


def test_fields_of_every_type_are_read_as_the_guide_lays_them_out():
    types = {
        "a": "BOOL", "b": "UINT8", "c": "UINT32", "d": "UINT64", "e": "INT32", "f": "DOUBLE", "g": "VECTOR3D",
        "h": "VECTOR6D", "i": "VECTOR6INT32", "j": "VECTOR6UINT32",
    }  # fmt: skip
    assert set(types.values()) == set(TYPES)
    payload = (
        b"\x07\x01\xfe" + (2**32 - 1).to_bytes(4, "big") + (2**64 - 2).to_bytes(8, "big") + b"\xff\xff\xff\xfb"
        + struct.pack(">d", -1.25) + struct.pack(">3d", *SIX[:3]) + struct.pack(">6d", *SIX)
        + struct.pack(">6i", *range(-6, 0)) + struct.pack(">6I", *range(6))
    )  # fmt: skip
    values = Recipe(7, types).unpack(payload)
    assert values == {
        "a": True, "b": 254, "c": 2**32 - 1, "d": 2**64 - 2, "e": -5, "f": -1.25, "g": SIX[:3], "h": SIX,
        "i": tuple(range(-6, 0)), "j": tuple(range(6)),
    }  # fmt: skip
    assert list(values) == list(types)
    assert Recipe(7, types).pack(values) == payload


@settings(deadline=None)
@given(st.lists(st.floats(allow_nan=False, width=64), min_size=8, max_size=8))
def test_values_survive_the_way_there_and_back(numbers):
    recipe = Recipe(255, {"timestamp": "DOUBLE", "actual_q": "VECTOR6D", "speed_scaling": "DOUBLE"})
    sent = {"timestamp": numbers[0], "actual_q": tuple(numbers[1:7]), "speed_scaling": numbers[7]}
    assert recipe.unpack(recipe.pack(sent)) == sent


def test_fields_know_their_types_and_since_when_they_are_sent():
    assert all(f.type in TYPES and f.name == name for name, f in FIELDS.items())
    torque = FIELDS["actual_current_as_torque"]
    sent_by = {
        v: torque.sent_by(v) for v in [(3, 15), (5, 22, 9), (5, 23), (5, 24, 0, 1), (10, 10), (10, 11, 0), (11, 0)]
    }
    assert list(sent_by.values()) == [False, False, True, True, False, True, True]
    assert all(f.sent_by((3, 5)) for f in FIELDS.values() if f is not torque)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("output_double_register_24", "DOUBLE"),
        ("input_int_register_0", "INT32"),
        ("output_int_register_47", "INT32"),
        ("output_double_register_48", None),
        ("output_bit_register_3", None),
        ("output_double_register_", None),
        ("actual_q", None),
    ],
)
def test_types_of_registers(name, kind):
    assert register_type(name) == kind
