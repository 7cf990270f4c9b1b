"""Packets of RTDE protocol version 2: framing, and the fields of data packets.

A packet is a big-endian uint16 with its total size, a uint8 with its kind, and the payload.
Source: Universal Robots, Real-Time Data Exchange (RTDE) guide.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from joint_id_core.rtde.errors import ProtocolError
from joint_id_core.rtde.fields import TYPES

VERSION = 2

REQUEST_VERSION, CONTROLLER_VERSION, TEXT, DATA, OUTPUTS, INPUTS, START, PAUSE = b"VvMUOISP"
KINDS = frozenset(b"VvMUOISP")

NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"  # in place of a type: an unknown field, an input that another client uses

_HEADER = struct.Struct(">HB")

Value = float | tuple[float, ...]


class Packet(NamedTuple):
    """One packet without its header."""

    kind: int
    payload: bytes


def encode(kind: int, payload: bytes = b"") -> bytes:
    """Return the bytes of a packet."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


class PacketReader:
    """Splits a stream of bytes into packets, independent of how the network split or joined them."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Yield the packets that are complete now, in order; the caller must read them all.

        Raises:
            ProtocolError: a packet of impossible size or unknown kind, raised after the packets before it. The start of
                the next packet cannot be found any more, so the connection must be closed.
        """
        self._rest += data
        at = 0
        try:
            while len(self._rest) - at >= _HEADER.size:
                size, kind = _HEADER.unpack_from(self._rest, at)
                if size < _HEADER.size or kind not in KINDS:
                    raise ProtocolError(
                        f"not RTDE: a packet of kind {kind} and {size} bytes (known kinds: {sorted(KINDS)})"
                    )
                if len(self._rest) - at < size:
                    break
                packet = Packet(kind, bytes(self._rest[at + _HEADER.size : at + size]))
                at += size
                yield packet
        finally:
            del self._rest[:at]


class Recipe:
    """The fields of a data packet, in order.

    Args:
        number: recipe id, which is the first byte of every data packet.
        types: type by field name, each a key of `fields.TYPES`.
    """

    def __init__(self, number: int, types: Mapping[str, str]) -> None:
        self.number = number
        self.types = dict(types)
        codes = [TYPES[kind] for kind in types.values()]
        self._layout = struct.Struct(">B" + "".join(f"{n}{code}" for code, n in codes))
        self._places: list[tuple[str, int, int]] = []
        at = 1
        for name, (_, n) in zip(types, codes, strict=True):
            self._places.append((name, at, n))
            at += n

    def unpack(self, payload: bytes) -> dict[str, Value]:
        """Return the values of a data packet by field; a vector is a tuple.

        Raises:
            ProtocolError: the packet has another recipe id or another size.
        """
        if len(payload) != self._layout.size or payload[0] != self.number:
            got = f"recipe {payload[0]}, {len(payload)} bytes" if payload else "nothing"
            raise ProtocolError(f"data packet of {got}: recipe {self.number} has {self._layout.size} bytes")
        row = self._layout.unpack(payload)
        return {name: row[at] if n == 1 else row[at : at + n] for name, at, n in self._places}

    def pack(self, values: Mapping[str, float | Sequence[float]]) -> bytes:
        """Return the payload of a data packet; inverse of `unpack`."""
        row: list[float] = []
        for name, _, n in self._places:
            value = values[name]
            row += [value] if n == 1 else value  # type: ignore[list-item, arg-type]  # n tells which of the two it is
        return self._layout.pack(self.number, *row)
