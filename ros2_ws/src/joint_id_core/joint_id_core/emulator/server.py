"""The listening socket of the emulator and its clients, without a thread of their own."""

from __future__ import annotations

import random
import socket
from selectors import EVENT_READ, BaseSelector

from joint_id_core.emulator.connection import Connection
from joint_id_core.emulator.controller import Controller
from joint_id_core.errors import JointIdError

_MOST_CLIENTS = 100  # select() takes no more than 1024 files


class Server:
    """Listens, takes requests and sends samples. The data of a selector key is what to call when it can be read.

    Args:
        host: address to listen at.
        port: TCP port; 0 takes any that is free.
        controller: what is asked and reported; may be replaced while there is no connection.
        selector: where sockets are registered.
        seed: of the pieces into which packets are cut.

    Raises:
        JointIdError: cannot listen there.
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
        """Begin to take connections.

        Raises:
            JointIdError: another program has begun to listen there.
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
        except OSError:  # gone again before it was taken
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
        """Whether anyone takes samples."""
        return any(c.streaming for c in self.connections)

    def publish(self, tick: int) -> None:
        """Send the sample of a tick to all who take it."""
        for connection in self.connections:
            connection.publish(tick)

    def flush(self, now: float) -> None:
        """Send what waits."""
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
        """Take no more connections until `listen`; the port stays ours."""
        self._selector.unregister(self._listener)
        self._listener.close()
        self._listener = _bound(*self.address)

    def close(self) -> None:
        """End everything."""
        self.cut()
        self._listener.close()


def _bound(host: str, port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    # A port whose former connections are not yet forgotten can be taken again.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except (OSError, OverflowError) as error:
        listener.close()
        raise _cannot_listen(host, port, error) from None
    return listener


def _cannot_listen(host: str, port: int, error: Exception) -> JointIdError:
    return JointIdError(f"cannot listen at {host}:{port}: {error}: choose another --host or --port")
