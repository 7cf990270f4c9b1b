"""Work on recordings on a cluster of Dask: the computers of its workers see the same files, and have joint_id."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
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
    here = versions().partition(",")[0]
    try:
        found = client.run(versions)
    except Exception as error:  # of a worker that cannot import the function
        raise JointIdError(
            f"--dask {address}: a worker does not have {here} ({' '.join(str(error).split())}): install it there"
        ) from None
    for worker, there in found.items():
        if there.partition(",")[0] != here:
            raise JointIdError(f"--dask {address}: {worker} has {there}, here is {here}: install the same version")


def _done(client: Any, work: Work, found: Sequence[Found], address: str) -> Iterator[Done]:
    from distributed import wait
    from distributed.scheduler import KilledWorker

    waiting, running = list(reversed(found)), dict[Any, Found]()
    while waiting or running:
        room = AHEAD * max(1, sum(client.nthreads().values()))
        while waiting and len(running) < room:
            one = waiting.pop()
            running[client.submit(work.rows, one, key=f"joint_id-{one.place}-{id(work):x}", pure=False)] = one
        try:
            done = wait(list(running), timeout=PACE_S, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            if client.status != "running":
                raise _lost(address) from None
            continue
        except Exception as error:  # the futures are cancelled when the connection is lost
            raise _lost(address) from error
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
