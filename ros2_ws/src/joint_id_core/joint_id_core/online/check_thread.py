"""A thread that does what is to be done beside the recursion."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")
_one_at_a_time = threading.Lock()  # in the whole process: identifiers of several robots share its cores


class CheckThread:
    """Does jobs one after the other in a thread that is there from the start; it does not hold up the process's end.

    It is a `checks.Background` for the identifiers of all joints of a robot.
    """

    def __init__(self) -> None:
        self._jobs = SimpleQueue[tuple[Callable[[], Any], Future[Any]] | None]()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="checks of windows", daemon=True)
        self._thread.start()

    def __call__(self, job: Callable[[], T]) -> Future[T]:
        """Start a job, when those before have ended; return its result when it has ended."""
        done: Future[T] = Future()
        self._jobs.put((job, done))
        return done

    def stop(self) -> None:
        """End the thread after the job that it does, and do none of those that wait; nobody asks for their results."""
        self._stop.set()
        self._jobs.put(None)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None and not self._stop.is_set():
            _do(*job)
            del job  # it holds samples


def _do(job: Callable[[], T], done: Future[T]) -> None:
    try:
        with _one_at_a_time:
            done.set_result(job())
    except BaseException as error:  # told to the one who asks for the result
        done.set_exception(error)
