"""The state file while a node runs: locked, read once, and written soon after something is new."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from joint_id_core.errors import JointIdError
from joint_id_core.stored.autosave import Autosave
from joint_id_core.stored.file_lock import FileLock
from joint_id_core.stored.state_file import Known, StateFile


class StateStore:
    """Keeps what `content` returns in the file that is open, if any."""

    def __init__(
        self,
        content: Callable[[], Mapping[str, Known]],
        problem: Callable[[str, str], None],
        clock: Callable[[], float],
    ) -> None:
        """Begin without a file.

        Args:
            content: returns what is to be written, by joint; called from a thread of the store.
            problem: called with kind and text of a problem.
            clock: wall clock in s since 1970.
        """
        self._content, self._tell, self._clock = content, problem, clock
        self._asked_for = ""
        self._file: StateFile | None = None
        self._lock: FileLock | None = None
        self._saver: Autosave | None = None
        self._unread = ""  # why a file was not read, until it is

    @property
    def path(self) -> Path | None:
        """Path of the file that is open, if any."""
        return None if self._file is None else self._file.path

    @property
    def problem(self) -> str:
        """Why nothing is read from the file or written to it; empty while all is well."""
        return self._unread or ("" if self._saver is None else self._saver.problem)

    def open(self, path: str) -> dict[str, Known]:
        """Open another file and return what it holds, or nothing; a problem is reported. An empty path means none."""
        if path == self._asked_for and (self._file is not None or not path):
            return {}
        self.close()
        self._asked_for, self._unread = path, ""
        if not path:
            return {}
        file = StateFile(path)
        lock = FileLock(file.path)
        try:
            lock.take()
            self._lock = lock
            self._file, self._saver = file, Autosave(self._write, self._tell)
            return file.read()
        except JointIdError as error:
            self._unread = str(error)
            self._tell("state file", self._unread)
            return {}

    def read(self) -> dict[str, Known]:
        """Return what the file holds.

        Raises:
            JointIdError: there is no file, or it cannot be read.
        """
        file, _ = self._opened()
        known = file.read()
        if not known:
            raise JointIdError(f"state file {file.path}: there is no such file")
        self._unread = ""
        return known

    def save(self) -> Path:
        """Write the file now and return its path.

        Raises:
            JointIdError: it cannot be written, or none is open.
        """
        file, saver = self._opened()
        saver.save()
        return file.path

    def remove(self) -> Path | None:
        """Delete the file, if one is open, and return its path.

        Raises:
            JointIdError: it cannot be deleted.
        """
        if self._file is None or self._saver is None:
            return None
        self._saver.forget(self._file.remove)
        self._unread = ""
        return self._file.path

    def ask(self) -> None:
        """Say that something is new."""
        if self._saver is not None:
            self._saver.ask()

    def flush(self) -> None:
        """Write the file if something is new; a problem is reported."""
        if self._saver is not None:
            self._saver.flush()

    def close(self) -> None:
        """Write the file if something is new, and leave it."""
        if self._saver is not None:
            self._saver.close()
        if self._lock is not None:
            self._lock.release()
        self._file = self._lock = self._saver = None

    def values(self) -> dict[str, object]:
        """Return figures for the diagnostics."""
        if self._file is None or self._saver is None:
            return {"state file": "none"}
        return {"state file": str(self._file.path), "state file written": self._saver.count}

    def _write(self) -> None:
        content = self._content()
        if self._file is not None and content:
            self._file.write(content, self._clock())

    def _opened(self) -> tuple[StateFile, Autosave]:
        if self._file is None or self._saver is None:
            raise JointIdError(self._unread or "there is no file: set the parameter state_file and configure")
        return self._file, self._saver
