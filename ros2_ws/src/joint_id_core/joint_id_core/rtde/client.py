"""Interface of an RTDE client; the implementations are `socket_client` and `ur_rtde_client`."""

from __future__ import annotations

import math
import re
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from joint_id_core.errors import JointIdError
from joint_id_core.rtde.fields import PORT
from joint_id_core.rtde.packets import Value


@dataclass(frozen=True)
class Request:
    """Robot to read from, and the fields to read.

    Attributes:
        host: name or address of the controller.
        fields: output fields; `timestamp` must be among them.
        rate: samples per second.
        port: TCP port.
        timeout: longest wait in s for the connection and for each answer of the handshake.

    Raises:
        JointIdError: a request that no robot can fulfil.
    """

    host: str
    fields: tuple[str, ...]
    rate: float = 500.0
    port: int = PORT
    timeout: float = 2.0

    def __post_init__(self) -> None:
        """Check all that can be checked without a robot."""
        if not self.host.strip():
            raise JointIdError("host of the robot is empty: give its name or address")
        if not 0 < self.port < 65536:
            raise JointIdError(f"port {self.port}: must be in [1, 65535]")
        if "timestamp" not in self.fields:
            raise JointIdError("field timestamp is not asked for: without it lost samples are not seen")
        for name in self.fields:
            if not re.fullmatch(r"\w+", name, re.ASCII):
                raise JointIdError(f"field {name!r}: a field's name has letters, digits and underscores only")
        twice = [name for name in self.fields if self.fields.count(name) > 1]
        if twice:
            raise JointIdError(f"field {twice[0]} is asked for twice")
        for name in ("rate", "timeout"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise JointIdError(f"{name} = {getattr(self, name)}: must be positive and finite")


class Sample(NamedTuple):
    """One data packet: values by field, and the system time in ns at which it was received."""

    received_ns: int
    values: dict[str, Value]


class Client(Protocol):
    """One connection to one robot, used once: `open`, `start`, repeated `read`, `close`."""

    version: tuple[int, ...]  # version of the controller, (major, minor, bugfix, build), known after `open`
    messages: deque[str]  # texts that the controller has sent, oldest first; the caller removes them

    def open(self) -> None:
        """Connect and agree on the fields; no samples are sent yet.

        Raises:
            UnreachableError: no route, connection refused, or no answer within the request's timeout.
            ProtocolError: the other side does not speak RTDE.
            RefusedError: a field that the controller does not have, or a rate at which it cannot send.
        """

    def start(self) -> None:
        """Start the stream of samples. Raises as `open`."""

    def read(self, timeout: float) -> list[Sample]:
        """Return all samples that have arrived, in order; wait at most `timeout` in s for the first, else return [].

        Raises:
            UnreachableError: the connection has ended.
            ProtocolError: the received data are not RTDE.
        """

    def close(self) -> None:
        """End the connection; from any thread, any number of times. A running `read` returns or raises at once."""
