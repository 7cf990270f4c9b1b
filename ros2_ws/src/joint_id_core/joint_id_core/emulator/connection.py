"""One client of the emulator: its requests, its recipes, and the bytes that still have to be sent."""

from __future__ import annotations

import math
import random
import socket
import struct
import sys
from collections.abc import Sequence
from typing import Protocol

from joint_id_core.emulator.output import Output, ticks_between
from joint_id_core.rtde import packets
from joint_id_core.rtde.errors import ProtocolError
from joint_id_core.rtde.packets import Packet, PacketReader, Recipe, Value, encode

READ_TIMEOUT_S = 10.0  # a client that reads nothing for this time is disconnected
_SEND_BUFFER = 65536  # bytes in the kernel: about a second of samples, as in a small controller
_MOST_WAITING = 65536  # most bytes in this process, in addition to those
_MOST_RECIPES = 255
_FAREWELL_S = 1.0  # time in which a refused client can read the reason
_ERROR_LEVEL = 1  # level of text messages


class Controller(Protocol):
    """Interface of the controller that a connection uses."""

    version: tuple[int, ...]
    values: dict[str, Value | Sequence[float]]

    def type_of(self, name: str) -> str | None: ...
    def input_type_of(self, name: str) -> str | None: ...


class Connection:
    """One client. An invalid request ends its connection with a text message, and has no other effect.

    `held` maps input registers to the connection that writes them; all connections share it.
    """

    def __init__(self, sock: socket.socket, peer: str, controller: Controller, held: dict[str, Connection]) -> None:
        self.sock, self.peer = sock, peer
        self.outputs: list[Output] = []
        self.streaming = False
        self.closed = False
        self._controller, self._held = controller, held
        self._inputs: dict[int, Recipe] = {}
        self._agreed = False
        self._refused = False  # a recipe was refused: START will be refused, too
        self._reader = PacketReader()
        self._waiting = bytearray()
        self._blocked_since: float | None = None
        self._ends_at: float | None = None
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)

    def receive(self, now: float) -> None:
        """Read what the client has sent and answer it; `now` is the time in s of the caller's clock."""
        try:
            data = self.sock.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self.close()
        elif self._ends_at is None:
            try:
                for packet in self._reader.feed(data):
                    self._answer(packet)
            except ProtocolError as error:
                self._end(str(error), now)

    def publish(self, tick: int) -> None:
        """Queue the sample of this tick; a client that reads too slowly loses the whole sample."""
        if not self.streaming or self._ends_at is not None:
            return
        if self._blocked_since is not None or len(self._waiting) > _MOST_WAITING:
            return
        for output in self.outputs:
            if tick % output.every == 0:
                self._waiting += output.packet(self._controller.values)

    def insert(self, data: bytes) -> None:
        """Queue bytes that are not a packet."""
        if self.streaming:
            self._waiting += data

    def flush(self, now: float, pieces: random.Random | None = None) -> None:
        """Send the queued bytes, or with `pieces` a random part. Call it every tick: it also ends connections."""
        if self._ends_at is not None and now > self._ends_at:
            self.close()
        if not self._waiting or self.closed:
            return
        data: bytes | bytearray = self._waiting
        if pieces is not None:
            if pieces.random() < 0.5:
                return
            data = data[: pieces.randint(1, len(data))]
        wanted = len(data)
        try:
            sent = self.sock.send(data)
            if self._ends_at is not None and sent == len(self._waiting):
                self.sock.shutdown(socket.SHUT_WR)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.close()
            return
        del self._waiting[:sent]
        if sent == wanted:
            self._blocked_since = None
        elif sent or self._blocked_since is None:
            self._blocked_since = now
        elif now - self._blocked_since > READ_TIMEOUT_S:
            _tell(f"{self.peer} is cut off: it has not read for {READ_TIMEOUT_S:g} s")
            self.close()

    def _answer(self, packet: Packet) -> None:
        """Answer a request.

        Raises:
            ProtocolError: an invalid request.
        """
        kind, payload = packet
        if kind == packets.REQUEST_VERSION:
            (version,) = _unpack(">H", payload, "request for a protocol version")
            self._agreed = version == packets.VERSION
            self._reply(kind, bytes([self._agreed]))
        elif kind == packets.CONTROLLER_VERSION:
            self._reply(kind, struct.pack(">4I", *self._controller.version))
        elif kind == packets.TEXT:
            _tell(f"{self.peer} says {_text_of(payload)!r}")
        elif not self._agreed:
            raise ProtocolError(f"request {chr(kind)!r} before protocol version {packets.VERSION} was agreed on")
        elif kind == packets.OUTPUTS:
            self._set_up_outputs(payload)
        elif kind == packets.INPUTS:
            self._set_up_inputs(payload)
        elif kind == packets.START:
            self.streaming = bool(self.outputs or self._inputs) and not self._refused
            self._reply(kind, bytes([self.streaming]))
        elif kind == packets.PAUSE:
            self.streaming = False
            self._reply(kind, b"\x01")
        else:
            self._take_inputs(payload)

    def _set_up_outputs(self, payload: bytes) -> None:
        if len(payload) < 8:
            raise ProtocolError(f"set-up of outputs with {len(payload)} bytes: it begins with the frequency, 8 bytes")
        (asked,) = struct.unpack_from(">d", payload)
        if not (math.isfinite(asked) and asked > 0.0):
            raise ProtocolError(f"set-up of outputs at {asked} Hz: the frequency must be finite and above 0")
        names = _names(payload[8:])
        types = [self._controller.type_of(name) or packets.NOT_FOUND for name in names]
        self._refused = packets.NOT_FOUND in types
        number = 0
        if not self._refused:
            number = self._next_number(len(self.outputs))
            recipe = Recipe(number, dict(zip(names, types, strict=True)))
            self.outputs.append(Output(recipe, ticks_between(asked, self._controller.version)))
        self._reply(packets.OUTPUTS, bytes([number]) + ",".join(types).encode())

    def _set_up_inputs(self, payload: bytes) -> None:
        names = _names(payload)
        types = []
        for name in names:
            kind = self._controller.input_type_of(name) or packets.NOT_FOUND
            types.append(packets.IN_USE if self._held.get(name, self) is not self else kind)
        number = 0
        if not {packets.NOT_FOUND, packets.IN_USE} & set(types):
            number = self._next_number(len(self._inputs))
            self._inputs[number] = Recipe(number, dict(zip(names, types, strict=True)))
            self._held.update(dict.fromkeys(names, self))
        self._reply(packets.INPUTS, bytes([number]) + ",".join(types).encode())

    @staticmethod
    def _next_number(taken: int) -> int:
        if taken == _MOST_RECIPES:
            raise ProtocolError(f"more than {_MOST_RECIPES} recipes on one connection")
        return taken + 1

    def _take_inputs(self, payload: bytes) -> None:
        number = payload[0] if payload else 0
        if number not in self._inputs:
            raise ProtocolError(f"input data of recipe {number}, which was not set up")
        self._controller.values.update(self._inputs[number].unpack(payload))

    def _reply(self, kind: int, payload: bytes) -> None:
        if len(self._waiting) > _MOST_WAITING:
            raise ProtocolError("requests without end, and nobody reads the answers")
        self._waiting += encode(kind, payload)

    def _end(self, why: str, now: float) -> None:
        """Send the reason to the client, and end the connection after `_FAREWELL_S`."""
        _tell(f"{self.peer} is cut off: {why}")
        message, source = why.encode()[:255], b"robot-emulator"
        payload = bytes([len(message)]) + message + bytes([len(source)]) + source + bytes([_ERROR_LEVEL])
        self._waiting += encode(packets.TEXT, payload)
        self._ends_at = now + _FAREWELL_S

    def close(self) -> None:
        """End the connection at once."""
        if not self.closed:
            self.closed = True
            self.sock.close()
            for name in [n for n, holder in self._held.items() if holder is self]:
                del self._held[name]


def _names(payload: bytes) -> list[str]:
    """Return the names of a comma-separated list; one comma at the end is allowed, because ur_rtde sends it."""
    try:
        names = payload.decode("ascii").removesuffix(",").split(",")
    except UnicodeDecodeError:
        raise ProtocolError(f"names of fields that are not ASCII: {payload[:40]!r}") from None
    if not all(names):
        raise ProtocolError("an empty name in the list of fields")
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ProtocolError(f"field {min(twice)} is asked for twice in one recipe")
    return names


def _unpack(layout: str, payload: bytes, what: str) -> tuple[int, ...]:
    if len(payload) != struct.calcsize(layout):
        raise ProtocolError(f"{what} with {len(payload)} bytes: it has {struct.calcsize(layout)}")
    return struct.unpack(layout, payload)


def _text_of(payload: bytes) -> str:
    """Return the message of a text packet."""
    length = payload[0] if payload else 0
    if not 0 < length < len(payload):
        raise ProtocolError(f"text message of {length} characters in a packet of {len(payload)} bytes")
    return payload[1 : 1 + length].decode("utf-8", "replace")


def _tell(text: str) -> None:
    print(f"robot-emulator: {text}", file=sys.stderr, flush=True)
