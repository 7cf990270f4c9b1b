"""The listening socket of the emulator and its clients, without threads."""

from __future__ import annotations

import random
import socket
from selectors import EVENT_READ, BaseSelector

from joint_id_core.emulator.connection import Connection
from joint_id_core.emulator.controller import Controller
from joint_id_core.errors import JointIdError

_MOST_CLIENTS = 100  # select() handles at most 1024 files


class Server:
    """Listens, handles requests and sends samples.

    Args:
        host: address to listen at.
        port: TCP port; 0 takes any free port.
        controller: answers requests and reports values; it may be replaced while there is no connection.
        selector: sockets are registered here; the data of a key is the function to call when its socket is readable.
        seed: seed of the random pieces into which packets are split.

    Raises:
        JointIdError: cannot listen at this address and port.
    """

    def __init__(self, host: str, port: int, controller: Controller, selector: BaseSelector, seed: int) -> None:
        self.controller = controller
        self.fragment = False
        self.connections: list[Connection] = []
        self._selector = selector
        self._pieces = random.Random(seed)
        self._held: dict[str, Connection] = {}
        self._listener = _bound(host, port)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]

    def listen(self) -> None:
        """Begin to accept connections.

        Raises:
            JointIdError: another program listens at this address and port.
        """
        try:
            self._listener.listen()
        except OSError as error:
            raise _cannot_listen(*self.address, error) from None
        self._listener.setblocking(False)
        self._selector.register(self._listener, EVENT_READ, self._accept)

    def _accept(self, now: float) -> None:
        try:
            sock, peer = self._listener.accept()
        except OSError:  # the client disconnected before it was accepted
            return
        if len(self.connections) >= _MOST_CLIENTS:
            sock.close()
            return
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = Connection(sock, f"{peer[0]}:{peer[1]}", self.controller, self._held)
        self.connections.append(connection)
        self._selector.register(sock, EVENT_READ, lambda now: self._receive(connection, now))

    def _receive(self, connection: Connection, now: float) -> None:
        connection.receive(now)
        self._forget_closed()

    @property
    def streaming(self) -> bool:
        """Whether any client receives samples."""
        return any(c.streaming for c in self.connections)

    def publish(self, tick: int) -> None:
        """Queue the sample of a tick for all clients that receive samples."""
        for connection in self.connections:
            connection.publish(tick)

    def flush(self, now: float) -> None:
        """Send the queued bytes."""
        for connection in self.connections:
            connection.flush(now, self._pieces if self.fragment else None)
        self._forget_closed()

    def _forget_closed(self) -> None:
        for connection in [c for c in self.connections if c.closed]:
            self._selector.unregister(connection.sock)
            self.connections.remove(connection)

    def cut(self) -> int:
        """End all connections; return how many there were."""
        count = len(self.connections)
        for connection in self.connections:
            connection.close()
        self._forget_closed()
        return count

    def stop_listening(self) -> None:
        """Accept no more connections until `listen`; the port stays reserved."""
        self._selector.unregister(self._listener)
        self._listener.close()
        self._listener = _bound(*self.address)

    def close(self) -> None:
        """End everything."""
        self.cut()
        self._listener.close()


def _bound(host: str, port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # SO_REUSEADDR: the port can be bound again while its old connections are still in TIME_WAIT.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except (OSError, OverflowError) as error:
        listener.close()
        raise _cannot_listen(host, port, error) from None
    return listener


def _cannot_listen(host: str, port: int, error: Exception) -> JointIdError:
    return JointIdError(f"cannot listen at {host}:{port}: {error}: choose another --host or --port")
