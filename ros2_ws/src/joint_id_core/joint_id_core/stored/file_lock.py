"""Keep other processes off a state file."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from joint_id_core.errors import JointIdError


class FileLock:
    """The right of one process to use a file; held by an empty file beside it, which stays.

    Two identifiers with one file would take each other's knowledge for their own.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._handle: int | None = None

    def take(self) -> None:
        """Keep other processes off the file, until `release` or the end of this process.

        Raises:
            JointIdError: another process uses the file.
        """
        if self._handle is not None:
            return
        beside = self._path.with_name(f"{self._path.name}.lock")
        try:
            handle = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError:
            return  # what cannot be written cannot be spoiled by two processes: writing says why it fails
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise JointIdError(
                f"state file {self._path} is in use by another node: nothing is stored. Give every identifier a "
                "state_file of its own"
            ) from None
        except OSError:  # a file system without locks
            os.close(handle)
            return
        self._handle = handle

    def release(self) -> None:
        """Let other processes use the file."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
