"""Work on recordings on a cluster of Dask: the computers of its workers see the same files, and have joint_id."""

from __future__ import annotations

import asyncio
import math
import time
import uuid
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from typing import Any

from joint_id_core.batch.cores import Done
from joint_id_core.batch.recordings import Found
from joint_id_core.batch.row import CRASHED
from joint_id_core.batch.versions import versions
from joint_id_core.batch.work import Work
from joint_id_core.errors import JointIdError

PATIENCE_S = 10.0  # for an answer of the scheduler, and for its first worker
PACE_S = 2.0  # between looks at the connection
AHEAD = 2  # recordings that each thread of a worker may have waiting
CRASH = (
    "the workers that fitted it ended, one after the other: look at it alone (joint-id fit), or give them more memory"
)


def on_cluster(work: Work, found: Sequence[Found], address: str) -> Iterator[Done]:
    """Work on the cluster of a scheduler; yield recordings with their rows as they are done.

    A recording whose worker ends is given to another one; after three workers it is given up, and its row says so.

    Raises:
        JointIdError: no scheduler answers, it has no worker, the workers have another joint_id or none, or the
            connection was lost.
    """
    client = _connected(address)
    try:
        _require_same_library(client, address)
        yield from _done(client, work, found, address)
    finally:
        client.close(timeout=PATIENCE_S)


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise JointIdError("--dask needs the package distributed: pip install distributed") from None
    try:
        client = Client(address, timeout=PATIENCE_S)
    except (OSError, TimeoutError, ValueError) as error:
        said = " ".join(str(error).split())
        raise JointIdError(
            f"--dask {address}: no scheduler answers ({said}): start one with dask scheduler, and give its address, "
            "such as tcp://host:8786"
        ) from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        client.close(timeout=PATIENCE_S)
        raise JointIdError(
            f"--dask {address}: the scheduler has no worker: start some with dask worker {address} --nthreads 1"
        ) from None
    return client


def _require_same_library(client: Any, address: str) -> None:
    here = _here()
    try:
        found = client.run(versions)
    except Exception as error:  # of a worker that cannot import the function
        raise JointIdError(
            f"--dask {address}: a worker does not have {here} ({' '.join(str(error).split())}): install it there"
        ) from None
    for worker, there in found.items():
        if there.partition(",")[0] != here:
            raise JointIdError(f"--dask {address}: {worker} has {there}, here is {here}: install the same version")


def _here() -> str:
    return versions().partition(",")[0]


def _done(client: Any, work: Work, found: Sequence[Found], address: str) -> Iterator[Done]:
    from distributed import wait
    from distributed.scheduler import KilledWorker

    waiting, running, run = list(reversed(found)), dict[Any, Found](), uuid.uuid4().hex
    room, looked = 0, -math.inf
    while waiting or running:
        if time.monotonic() > looked + PACE_S:  # workers come and go
            try:
                room, looked = AHEAD * max(1, sum(client.nthreads().values())), time.monotonic()
            except OSError:
                raise _lost(address) from None
        while waiting and len(running) < room:
            one = waiting.pop()
            running[client.submit(work.rows, one, key=f"joint_id-{one.place}-{run}", pure=False)] = one
        try:
            done = wait(list(running), timeout=PACE_S, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            if client.status != "running":
                raise _lost(address) from None
            continue
        except (CancelledError, asyncio.CancelledError):  # as all futures are when the connection is lost
            raise _lost(address) from None
        for future in done:
            one = running.pop(future)
            if future.status == "finished":
                yield one, future.result()
            elif future.status == "error" and isinstance(future.exception(), KilledWorker):
                yield one, work.failed(one, CRASHED, CRASH)
            elif future.status == "error":
                raise JointIdError(f"--dask {address}: {one.place}: {future.exception()}: look at the worker's log")
            else:
                raise _lost(address)
            future.release()


def _lost(address: str) -> JointIdError:
    return JointIdError(
        f"--dask {address}: the connection was lost: what is finished is kept; give the same command again to go on"
    )
