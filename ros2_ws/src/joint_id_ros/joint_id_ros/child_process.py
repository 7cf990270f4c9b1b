"""Work in a process of its own: it takes no time from the callbacks of a node, and can be ended at any moment."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

from joint_id_core.errors import JointIdError

T = TypeVar("T")
Tell = Callable[[float, str], None]  # called with the share that is done, 0 to 1, and what is done now
END_S = 5.0  # longest wait for the end of a process


class ChildProcess(Generic[T]):
    """Runs a function of a module with arguments that can be pickled.

    Attributes:
        share, text: what the function told last.

    Args:
        work: called with a function that tells progress, and the arguments.
        arguments: for it.
    """

    def __init__(self, work: Callable[..., T], *arguments: object) -> None:
        self.share, self.text = 0.0, ""
        self._found: list[T] = []
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_run, args=(theirs, work, arguments), daemon=True)
        self._process.start()
        theirs.close()

    def result(self) -> list[T]:
        """Return the result in a list, which is empty as long as there is none; never waits.

        Raises:
            JointIdError: the work has failed, or its process has ended without a result.
        """
        try:
            while not self._found and self._pipe.poll():
                kind, *content = self._pipe.recv()
                if kind == "told":
                    self.share, self.text = content
                elif kind == "failed":
                    raise JointIdError(content[0])
                else:
                    self._found = content
        except EOFError:
            self._process.join(END_S)
            raise JointIdError(
                f"the computation ended with exit code {self._process.exitcode}: was it killed, or is memory short?"
            ) from None
        return self._found

    def end(self) -> None:
        """End the process, whatever it does; may be called more than once."""
        self._process.terminate()
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.kill()
        self._pipe.close()


def _run(pipe: Connection, work: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    """Run in the new process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group: the parent decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        pipe.send(("done", work(lambda share, text: pipe.send(("told", share, text)), *arguments)))
    except JointIdError as error:
        pipe.send(("failed", str(error)))


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
