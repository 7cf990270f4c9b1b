"""Threads of which one has the lead, and another one takes it while that one does something that takes long."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Generic, TypeVar

T = TypeVar("T")


class Relay(Generic[T]):
    """Threads of which one has the lead. All are there from the start and wait, so that their number never changes.

    Args:
        count: number of threads.
        run: is called in a thread that gets the lead, with what it was given; it returns once it has lost the lead.
        name: of the threads.
    """

    def __init__(self, count: int, run: Callable[[T], None], name: str) -> None:
        self._run = run
        self._turns = SimpleQueue[tuple[int, T] | None]()
        self._newest, self._own = 0, threading.local()  # numbers of turns: of the one with the lead, of each thread
        self._waiting, self._changed = count, threading.Condition()
        # daemon threads: a compilation must not delay the end of the process
        self._threads = [threading.Thread(target=self._work, name=name, daemon=True) for _ in range(count)]
        for thread in self._threads:
            thread.start()

    @property
    def leads(self) -> bool:
        """Whether the thread that asks has the lead."""
        return bool(self._own.turn == self._newest)

    def hand_over(self, given: T) -> bool:
        """Give the lead to a thread that waits; return whether there is one."""
        with self._changed:
            if not self._waiting:
                return False
            self._waiting, self._newest = self._waiting - 1, self._newest + 1
            self._turns.put((self._newest, given))
        return True

    def wait_for_others(self) -> None:
        """Wait until the thread that asks is the only one that works."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting == len(self._threads) - 1)

    def stop(self, longest_s: float) -> None:
        """End the threads that wait, and the others when they return; wait for them, but for no more than a time in s.

        Those that lead or do something then must have been told to return.
        """
        end_s = time.monotonic() + longest_s
        for _ in self._threads:
            self._turns.put(None)
        for thread in self._threads:
            thread.join(max(0.0, end_s - time.monotonic()))

    def _work(self) -> None:
        while (turn := self._turns.get()) is not None:
            self._own.turn, given = turn
            self._run(given)
            with self._changed:
                self._waiting += 1
                self._changed.notify_all()
