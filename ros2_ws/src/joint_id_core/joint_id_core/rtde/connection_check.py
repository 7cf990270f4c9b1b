"""Check once, in a thread, whether a robot offers the requested fields. A robot that does not answer blocks nothing."""

from __future__ import annotations

import threading

from joint_id_core.rtde.client import Client
from joint_id_core.rtde.errors import RobotError, UnreachableError


class ConnectionCheck:
    """One connection that is opened and, after the handshake, closed again."""

    def __init__(self, client: Client) -> None:
        """Start to connect, in a thread."""
        self._client = client
        self._version: tuple[int, ...] = ()
        self._error: RobotError | None = UnreachableError("the check of the connection was given up")
        self._thread = threading.Thread(target=self._run, name="connection check", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether the check has ended, so that `version` returns at once."""
        return not self._thread.is_alive()

    def version(self) -> tuple[int, ...]:
        """Wait for the end of the check and return the controller's version, (major, minor, bugfix, build).

        Raises:
            RobotError: as `Client.open`.
        """
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._version

    def cancel(self) -> None:
        """Cancel the check."""
        self._client.close()

    def _run(self) -> None:
        try:
            self._client.open()
            self._version, self._error = self._client.version, None
        except RobotError as error:
            self._error = error
        finally:
            self._client.close()
