"""What a client of RTDE is asked for and gives; `socket_client` and `ur_rtde_client` are the two that exist."""

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
    """What to read from which robot.

    Attributes:
        host: name or address of the controller.
        fields: output fields; `timestamp` must be among them.
        rate: samples a second.
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
        """Check what does not take a robot to know."""
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
    """One data packet: value by field, and the system time in ns at which it was taken from the network."""

    received_ns: int
    values: dict[str, Value]


class Client(Protocol):
    """One connection to one robot, used once: `open`, `start`, `read` again and again, `close`."""

    version: tuple[int, ...]  # of the controller, (major, minor, bugfix, build), once open
    messages: deque[str]  # texts that the controller has sent, oldest first; whoever reads one takes it out

    def open(self) -> None:
        """Connect and agree on the fields; nothing streams yet.

        Raises:
            UnreachableError: no route, refused, or no answer within the request's timeout.
            ProtocolError: what answers does not speak RTDE.
            RefusedError: a field that the controller lacks, a rate that it cannot send at.
        """

    def start(self) -> None:
        """Let the stream begin. Raises as `open`."""

    def read(self, timeout: float) -> list[Sample]:
        """All samples that have arrived, in order; waits for the first at most `timeout` in s, then returns [].

        Raises:
            UnreachableError: the connection has ended.
            ProtocolError: not RTDE.
        """

    def close(self) -> None:
        """End the connection; from any thread, any number of times. A `read` under way returns or raises at once."""
