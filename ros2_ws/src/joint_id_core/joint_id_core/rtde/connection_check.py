"""Asks a robot once whether it offers what is wanted, in a thread, so that a robot that is mute holds nothing up."""

from __future__ import annotations

import threading

from joint_id_core.rtde.client import Client
from joint_id_core.rtde.errors import RobotError, UnreachableError


class ConnectionCheck:
    """One connection that is opened, agreed on, and closed again."""

    def __init__(self, client: Client) -> None:
        """Begin to connect."""
        self._client = client
        self._version: tuple[int, ...] = ()
        self._error: RobotError | None = UnreachableError("the check of the connection was given up")
        self._thread = threading.Thread(target=self._run, name="connection check", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether `version` answers at once."""
        return not self._thread.is_alive()

    def version(self) -> tuple[int, ...]:
        """Version of the controller, (major, minor, bugfix, build), which offers all; waits for it.

        Raises:
            RobotError: as `Client.open`.
        """
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._version

    def cancel(self) -> None:
        """Give up."""
        self._client.close()

    def _run(self) -> None:
        try:
            self._client.open()
            self._version, self._error = self._client.version, None
        except RobotError as error:
            self._error = error
        finally:
            self._client.close()
