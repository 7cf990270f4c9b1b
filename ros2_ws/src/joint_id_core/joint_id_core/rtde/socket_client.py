"""joint_id's own RTDE client: it reads every packet from the socket, so that this computer loses no samples."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections import deque
from contextlib import suppress

from joint_id_core.rtde import packets
from joint_id_core.rtde.client import Request, Sample
from joint_id_core.rtde.errors import ProtocolError, RefusedError, UnreachableError
from joint_id_core.rtde.fields import FIELDS, TYPES
from joint_id_core.rtde.packets import Packet, PacketReader, Recipe, encode
from joint_id_core.rtde.rates import sent_rate

_CHUNK = 65536  # bytes read at once; one second of samples has a few times as many
_MESSAGES_KEPT = 100
_WAKE_EVERY_S = 0.01
_PAUSE_S = 0.005  # between two readings of samples: to wake up for each packet would cost more than the packets


class SocketClient:
    """One connection over a plain socket; see `client.Client`.

    Attributes:
        version: version of the controller, (major, minor, bugfix, build), known after `open`.
        messages: texts that the controller has sent, oldest first; the caller removes them.
    """

    def __init__(self, request: Request) -> None:
        self.version: tuple[int, ...] = ()
        self.messages: deque[str] = deque(maxlen=_MESSAGES_KEPT)
        self._request = request
        self._robot = f"robot {request.host}:{request.port}"
        self._reader = PacketReader()
        self._packets: deque[Packet] = deque()  # arrived, but not yet processed
        self._next_read = 0.0  # earliest time.monotonic() of the next reading
        self._received_ns = 0  # when these packets were read
        self._broken: ProtocolError | None = None  # error in the data after these packets
        self._recipe = Recipe(0, {})
        self._sock: socket.socket | None = None
        self._closed = False
        self._state = threading.Lock()  # guards _sock and _closed
        self._in_use = threading.RLock()  # held while a thread waits on the socket, which must not be closed meanwhile

    def open(self) -> None:
        """See `client.Client.open`."""
        try:
            self._connect()
            self._agree()
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """See `client.Client.start`."""
        if self._ask(packets.START, b"", "START") != b"\1":
            raise RefusedError(f"{self._robot} does not start its stream{self._said()}: restart the robot's controller")

    def read(self, timeout: float) -> list[Sample]:
        """See `client.Client.read`; samples that arrived together have one `received_ns`."""
        deadline = time.monotonic() + timeout
        samples = self._samples()
        if not samples and (pause := self._next_read - time.monotonic()) > 0.0:
            time.sleep(min(pause, timeout))
        while not samples:
            left = deadline - time.monotonic()
            if not self._receive(max(0.0, left)) or left < 0.0:
                break
            samples = self._samples()
        self._next_read = time.monotonic() + _PAUSE_S
        return samples

    def close(self) -> None:
        """See `client.Client.close`."""
        with self._state:
            self._closed = True
            sock = self._sock
        if sock is None:
            return
        held = False
        while not held:
            with suppress(OSError):  # not connected, or not any more
                sock.shutdown(socket.SHUT_RDWR)  # wakes a thread that waits on it, but not one before its connect()
            held = self._in_use.acquire(timeout=_WAKE_EVERY_S)
        sock.close()
        self._in_use.release()

    def _connect(self) -> None:
        """Connect to the first of the host's addresses that answers."""
        host, port, timeout = self._request.host, self._request.port, self._request.timeout
        deadline = time.monotonic() + timeout
        try:
            addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except (OSError, ValueError) as error:  # ValueError: not a possible host name
            why = f"{getattr(error, 'strerror', None) or error}: check the robot's name or address"
            raise UnreachableError(f"host {host!r} is not known: {why}") from None
        why = ""
        for family, kind, protocol, _, address in addresses:
            sock = socket.socket(family, kind, protocol)
            with self._state:
                if self._closed:
                    sock.close()
                    raise self._closed_by_us()
                self._sock = sock
            try:
                with self._in_use:
                    sock.settimeout(max(1e-3, deadline - time.monotonic()))
                    sock.connect(address)
                    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
                return
            except OSError as error:
                with self._in_use:
                    sock.close()
                if self._closed:
                    raise self._closed_by_us() from None
                why = why or _reason(error, timeout)
        raise UnreachableError(f"{self._robot}: {why}")

    def _agree(self) -> None:
        """Agree with the controller on protocol version, rate and fields."""
        accepted = self._ask(packets.REQUEST_VERSION, struct.pack(">H", packets.VERSION), "the protocol version")
        if accepted != b"\1":
            raise RefusedError(
                f"{self._robot} does not speak version {packets.VERSION} of RTDE: update the controller's software"
            )
        version = self._ask(packets.CONTROLLER_VERSION, b"", "the controller's version")
        if len(version) != 16:
            raise ProtocolError(f"{self._robot}: a controller version of {len(version)} bytes: it has 16")
        self.version = struct.unpack(">4I", version)
        names = self._request.fields
        wish = struct.pack(">d", sent_rate(self._request.rate, self.version)) + ",".join(names).encode()
        answer = self._ask(packets.OUTPUTS, wish, "the fields")
        types = answer[1:].decode("ascii", "replace").split(",")
        if len(types) != len(names):
            raise ProtocolError(f"{self._robot}: {len(types)} types for {len(names)} fields")
        offered = dict(zip(names, types, strict=True))
        missing = [name for name, kind in offered.items() if kind == packets.NOT_FOUND]
        if missing:
            raise RefusedError(
                f"{self._robot} has version {'.'.join(map(str, self.version[:3]))} and no field "
                f"{', '.join(map(_with_history, missing))}: leave it out, or update the controller's software"
            )
        for name, kind in offered.items():
            if kind not in TYPES:
                raise ProtocolError(f"{self._robot} sends {name} as {kind!r}: a type that is not known")
        self._recipe = Recipe(answer[0], offered)

    def _ask(self, kind: int, payload: bytes, what: str) -> bytes:
        """Send a request and return the payload of its answer; keep texts that arrive before the answer."""
        timeout = self._request.timeout
        deadline = time.monotonic() + timeout
        with self._in_use:
            sock = self._open_socket()
            try:
                sock.settimeout(timeout)
                sock.sendall(encode(kind, payload))
            except OSError as error:
                raise self._lost(_reason(error, timeout)) from None
        while True:
            while self._packets:
                packet = self._packets.popleft()
                if packet.kind == kind and packet.payload:
                    return packet.payload
                if packet.kind != packets.TEXT:
                    raise ProtocolError(
                        f"{self._robot}: packet of kind {chr(packet.kind)!r} in place of the answer on {what}"
                    )
                self.messages.append(_text(packet.payload))
            left = deadline - time.monotonic()
            if left < 0.0 or not self._receive(left):
                raise UnreachableError(
                    f"{self._robot} is connected but gives no answer on {what} within {timeout:g} s: "
                    "check that the port is the robot's RTDE port"
                )

    def _receive(self, wait: float) -> bool:
        """Read the data that have arrived; return False if nothing arrives within `wait` in s."""
        if self._broken is not None:
            raise self._broken
        with self._in_use:
            sock = self._open_socket()
            try:
                sock.settimeout(wait)
                data = sock.recv(_CHUNK)
                self._received_ns = time.time_ns()
            except (TimeoutError, BlockingIOError):
                return False
            except OSError as error:
                raise self._lost(_reason(error, wait)) from None
        if not data:
            raise self._lost("the robot ended the connection")
        try:
            self._packets.extend(self._reader.feed(data))
        except ProtocolError as error:
            port = "" if self._recipe.types else ": check that the port is the robot's RTDE port"
            self._broken = ProtocolError(f"{self._robot}: {error}{port}")  # the packets before it are still good
        return True

    def _samples(self) -> list[Sample]:
        """Return the samples that have arrived. A bad packet raises an error after those before it were returned."""
        samples: list[Sample] = []
        while self._packets:
            kind, payload = self._packets[0]
            if kind == packets.TEXT:
                self.messages.append(_text(payload))
            else:
                try:
                    if kind != packets.DATA:
                        raise ProtocolError(f"packet of kind {chr(kind)!r} among the samples")
                    samples.append(Sample(self._received_ns, self._recipe.unpack(payload)))
                except ProtocolError as error:
                    if samples:
                        break
                    raise ProtocolError(f"{self._robot}: {error}") from None
            self._packets.popleft()
        return samples

    def _open_socket(self) -> socket.socket:
        if self._sock is None or self._closed:
            raise self._closed_by_us()
        return self._sock

    def _lost(self, why: str) -> UnreachableError:
        return self._closed_by_us() if self._closed else UnreachableError(f"{self._robot}: {why}{self._said()}")

    def _closed_by_us(self) -> UnreachableError:
        return UnreachableError(f"{self._robot}: the connection is closed on this side")

    def _said(self) -> str:
        """Return the last text from the controller, which may name the reason."""
        return f" (it says: {self.messages[-1]})" if self.messages else ""


def _reason(error: OSError, timeout: float) -> str:
    """Return the meaning of a network error, and what to do."""
    if isinstance(error, ConnectionRefusedError):
        return "refuses the connection: check that the robot's controller is up and that the port is its RTDE port"
    if isinstance(error, TimeoutError):
        return f"no answer within {timeout:g} s: check address, cable, and that the robot's controller is up"
    return f"{error.strerror or error}: check address and cable"


def _with_history(name: str) -> str:
    """Return a field's name with the first versions that have it."""
    if name not in FIELDS:
        return name
    since = " and ".join(f"{major}.{minor}" for major, minor in FIELDS[name].since)
    return f"{name} (which came with {since})" if since else name


def _text(payload: bytes) -> str:
    """Return the message of a text packet (length and message, length and source, level) as one line."""
    length = payload[0] if payload else 0
    return " ".join(payload[1 : 1 + length].decode("utf-8", "replace").split())
