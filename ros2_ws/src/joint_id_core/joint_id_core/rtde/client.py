"""What a client of RTDE is asked for and gives; `socket_client` and `ur_rtde_client` are the two that exist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

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
    """

    host: str
    fields: tuple[str, ...]
    rate: float = 500.0
    port: int = PORT
    timeout: float = 2.0


class Sample(NamedTuple):
    """One data packet: value by field, and the system time in ns at which it was taken from the network."""

    received_ns: int
    values: dict[str, Value]


class Client(Protocol):
    """One connection to one robot, used once: `open`, `start`, `read` again and again, `close`."""

    version: tuple[int, ...]  # of the controller, (major, minor, bugfix, build), once open

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
