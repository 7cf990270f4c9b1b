"""Work on recordings in processes of this computer, one a core.

A process that ends (a crash, or the system that wants its memory) breaks the pool, and which recording it had is not
told. So each of those that were being worked on is done again alone in a process; the one that ends it again is told.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from joint_id_core.batch.recordings import Found
from joint_id_core.batch.row import CRASHED, Row
from joint_id_core.batch.work import Work

Done = tuple[Found, list[Row]]
AHEAD = 1  # recordings that wait in the pool, so that no process waits for one
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # of libraries: the processes share the cores
CRASH = (
    "its process ended twice, by a crash or for lack of memory: look at it alone (joint-id fit), or take fewer --jobs"
)


def here(work: Work, found: Sequence[Found]) -> Iterator[Done]:
    """Work in this process, on recordings that are only in its memory."""
    for one in found:
        yield one, work.rows(one)


def on_cores(work: Work, found: Sequence[Found], jobs: int) -> Iterator[Done]:
    """Work in `jobs` processes; yield recordings with their rows as they are done."""
    waiting = deque(found)
    suspects: deque[Found] = deque()
    while waiting:
        yield from _until_broken(work, waiting, jobs, suspects)
        while suspects:
            last: deque[Found] = deque()
            yield from _until_broken(work, suspects, 1, last, ahead=0)
            yield from ((one, work.failed(one, CRASHED, CRASH)) for one in last)


def _until_broken(
    work: Work, waiting: deque[Found], jobs: int, suspects: deque[Found], ahead: int = AHEAD
) -> Iterator[Done]:
    """Work until all is done or a process ends; then what was being worked on is in `suspects`."""
    running: dict[Future[list[Row]], Found] = {}
    with _one_thread(), _pool(min(jobs, len(waiting))) as pool:
        while waiting or running:
            try:
                while waiting and len(running) < jobs + ahead:
                    future = pool.submit(work.rows, waiting[0])
                    running[future] = waiting.popleft()
            except BrokenProcessPool:
                pass  # told by what is running, too
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            broken = False
            for future in done:
                if isinstance(future.exception(), BrokenProcessPool):
                    broken = True
                else:
                    yield running.pop(future), future.result()
            if broken:
                suspects.extend(running.values())
                return


def _pool(jobs: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=end_with_parent)


def end_with_parent() -> None:
    """End this process when its parent has ended, which may have had no time to tell it."""

    def wait_for_end() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait_for_end, daemon=True).start()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes that are started here use one thread each in numeric libraries."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
