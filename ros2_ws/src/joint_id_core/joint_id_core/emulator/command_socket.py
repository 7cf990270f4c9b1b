"""Commands to the emulator from another process of this computer."""

from __future__ import annotations

import socket
import stat
from collections.abc import Callable
from pathlib import Path
from selectors import EVENT_READ, BaseSelector

from joint_id_core.errors import JointIdError

ANSWER_S = 10.0  # longest wait of a client
REFUSED = "refused: "  # begins the answer to a command that was not carried out
_LONGEST = 65536  # bytes of a command
_MOST_CLIENTS = 10


class CommandSocket:
    """Takes commands, one a line, and answers each with one line.

    It is a socket in the file system and not a port: nothing on it can ever reach a robot on the network.

    Args:
        path: file to create; a socket that nobody listens at any more is replaced.
        selector: sockets are registered here; the data of a key is the function to call when its socket is readable.
        carry_out: carries a command out at a time in s, and returns the answer.

    Raises:
        JointIdError: the file cannot be created, or is something else, or another emulator listens there.
    """

    def __init__(self, path: Path, selector: BaseSelector, carry_out: Callable[[str, float], str]) -> None:
        self._path, self._selector, self._carry_out = path, selector, carry_out
        self._clients: dict[socket.socket, bytes] = {}
        _require_free(path)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._listener.bind(str(path))
        except OSError as error:
            self._listener.close()
            raise JointIdError(f"{path}: no socket can be made there: {error.strerror or error}") from None
        self._listener.listen()
        self._listener.setblocking(False)
        selector.register(self._listener, EVENT_READ, self._accept)

    def close(self) -> None:
        """End everything, and remove the file."""
        for client in list(self._clients):
            self._forget(client)
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def _accept(self, now: float) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:  # the client disconnected before it was accepted
            return
        if len(self._clients) >= _MOST_CLIENTS:
            client.close()
            return
        client.setblocking(False)
        self._clients[client] = b""
        self._selector.register(client, EVENT_READ, lambda now: self._receive(client, now))

    def _receive(self, client: socket.socket, now: float) -> None:
        try:
            data = client.recv(_LONGEST)
            *lines, rest = (self._clients[client] + data).split(b"\n")
            self._clients[client] = rest
            for line in lines:
                answer = self._carry_out(line.decode(errors="replace"), now)
                client.sendall(f"{answer}\n".encode())  # one line: it fits into the buffer of a client that waits
        except OSError:
            data = b""
        if not data or len(self._clients[client]) > _LONGEST:
            self._forget(client)

    def _forget(self, client: socket.socket) -> None:
        self._selector.unregister(client)
        client.close()
        del self._clients[client]


def give(path: Path, command: str) -> str:
    """Give a command to an emulator and return its answer.

    Raises:
        JointIdError: no emulator listens there, it does not answer, or it refuses.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(ANSWER_S)
        try:
            client.connect(str(path))
            client.sendall(f"{command}\n".encode())
            answer = b""
            while not answer.endswith(b"\n") and (more := client.recv(_LONGEST)):
                answer += more
        except OSError as error:
            reason = error.strerror or str(error) or type(error).__name__
            raise JointIdError(
                f"no answer of an emulator at {path} ({reason}): start it with --socket {path}"
            ) from None
    text = answer.decode(errors="replace").strip()
    if not text:
        raise JointIdError(f"the emulator at {path} ended before it answered to {command!r}")
    if text.startswith(REFUSED):
        raise JointIdError(text.removeprefix(REFUSED))
    return text


def _require_free(path: Path) -> None:
    """Remove a socket that an emulator which was killed has left.

    Raises:
        JointIdError: there is a file of another kind, or somebody listens there.
    """
    try:
        mode = path.stat().st_mode
    except OSError:
        return
    if not stat.S_ISSOCK(mode):
        raise JointIdError(f"{path} is there and is no socket: choose another name")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as trial:
        try:
            trial.connect(str(path))
        except OSError:
            path.unlink(missing_ok=True)
            return
    raise JointIdError(f"another emulator listens at {path}: choose another name, or end that one")
