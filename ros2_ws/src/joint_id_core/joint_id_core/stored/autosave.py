"""A thread that writes a file soon after something is new, so that nothing that computes waits for the disk."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from joint_id_core.errors import JointIdError

EVERY_S = 1.0  # shortest time between two writes


class Autosave:
    """Writes at most once a second, only when it is asked to.

    Attributes:
        count: number of times that the file was written.
        problem: why the last write failed; empty if it did not.
    """

    def __init__(self, write: Callable[[], None], problem: Callable[[str, str], None]) -> None:
        """Start the thread; `write` raises JointIdError, which `problem` gets as kind and text."""
        self.count, self.problem = 0, ""
        self._write, self._tell = write, problem
        self._asked, self._stop = threading.Event(), threading.Event()
        self._writing = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="autosave", daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """Say that something is new."""
        self._asked.set()

    def save(self) -> None:
        """Write now.

        Raises:
            JointIdError: the file cannot be written.
        """
        with self._writing:
            self._asked.clear()
            try:
                self._write()
            except JointIdError as error:
                self.problem = str(error)
                self._asked.set()
                raise
            self.count, self.problem = self.count + 1, ""

    def flush(self) -> None:
        """Write now if something is new; a failure is reported. A write that has begun ends first."""
        with self._writing:
            asked = self._asked.is_set()
        if asked:
            self._save_or_tell()

    def forget(self, remove: Callable[[], None]) -> None:
        """Call `remove`, which deletes the file, while nothing is written."""
        with self._writing:
            self._asked.clear()
            remove()

    def close(self) -> None:
        """Write if something is new, and end the thread."""
        self._stop.set()
        self.flush()
        self._asked.set()  # wakes the thread
        self._thread.join()

    def _run(self) -> None:
        while True:
            self._asked.wait()
            if self._stop.is_set():
                return
            begun = time.monotonic()
            self._save_or_tell()
            self._stop.wait(begun + EVERY_S - time.monotonic())

    def _save_or_tell(self) -> None:
        try:
            self.save()
        except JointIdError as error:
            self._tell("state file", str(error))
