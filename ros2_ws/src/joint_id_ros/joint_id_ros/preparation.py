"""Compile or load the kernels of a node's models in a thread, so that signals and other callbacks are served."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from joint_id_core.errors import JointIdError
from joint_id_ros.running import SIGNALS

POLL_S = 0.1  # longest time until a signal is noticed


class Preparation:
    """Runs jobs one after the other in a thread; `text` says in words what they do."""

    def __init__(self, jobs: Sequence[Callable[[], None]], text: str) -> None:
        self.text = text
        self._jobs = jobs
        self._error: Exception | None = None
        # A daemon: a compilation must not delay the end of the process.
        self._thread = threading.Thread(target=self._run, name="preparation", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether all jobs have ended."""
        return not self._thread.is_alive()

    def wait(self, meanwhile: Callable[[], None]) -> None:
        """Wait for the end; `meanwhile` is called from time to time.

        Raises:
            JointIdError: a signal asks the process to end; the jobs are abandoned.
            Exception: that of a job.
        """
        while not self.done:
            if SIGNALS:
                raise JointIdError(f"interrupted by a signal while {self.text}")
            meanwhile()
            self._thread.join(POLL_S)
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            for job in self._jobs:
                job()
        except Exception as error:  # `wait` raises it where it is reported
            self._error = error
