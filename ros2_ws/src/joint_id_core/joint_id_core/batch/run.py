"""Fit every joint of many recordings into one table, and go on where an earlier run was ended."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from joint_id_core.batch.cores import Done, here, on_cores
from joint_id_core.batch.recordings import Found
from joint_id_core.batch.row import FAILED, Row
from joint_id_core.batch.store import store
from joint_id_core.batch.table import finished, join, libraries, write_part
from joint_id_core.batch.work import Work
from joint_id_core.options import Progress

Pool = Callable[[Work, Sequence[Found]], Iterator[Done]]


@dataclass(frozen=True)
class Summary:
    """What a run did: recordings that were fitted, finished before, failed, and why; rows of the table by status."""

    fitted: int
    before: int
    failed: int
    failures: tuple[str, ...]
    rows: Mapping[str, int]
    said: tuple[str, ...]


def on_this_computer(jobs: int | None) -> Pool:
    """Return the pool of `jobs` processes, or of one a core."""

    def pool(work: Work, found: Sequence[Found]) -> Iterator[Done]:
        if any(one.place.startswith("memory://") for one in found):
            return here(work, found)  # no other process has them
        return on_cores(work, found, jobs or len(os.sched_getaffinity(0)))

    return pool


def run(
    found: Sequence[Found],
    work: Work,
    output: str,
    pool: Pool,
    again: bool = False,
    progress: Progress = lambda _: None,
) -> Summary:
    """Fit recordings and write the table `output`; those in it that did not change are left as they are.

    Args:
        found: from `recordings.find`.
        output: path or address of the table.
        pool: where the work is done.
        again: also do again what failed.

    Raises:
        JointIdError: the table was made with other options, is written by another process, cannot be written, or the
            pool fails. What was finished is kept, and the next run goes on from there.
    """
    libraries()
    place = store(output)
    with place.locked():
        known = finished(place, work.options)
        todo = [one for one in found if not known.has(one, again)]
        before = len(found) - len(todo)
        progress(f"{len(todo)} of {len(found)} recordings to fit" + (", the others are finished" if before else ""))
        failures: list[str] = []
        for one, rows in _timed(pool(work, todo), len(todo), before, progress):
            known.parts[one.place] = write_part(place, rows, one)
            failures += [_failure(one, row) for row in rows if row["status"] in FAILED][:1]
        progress(f"writing {output}")
        counts = join(place, known.parts)
        place.clear()
        return Summary(len(todo), before, len(failures), tuple(failures), dict(counts), tuple(known.said))


def _failure(one: Found, row: Row) -> str:
    """Return why a recording failed, with its place."""
    message = str(row["message"])
    return message if message.startswith(one.place) else f"{one.place}: {message}"


def _timed(results: Iterator[Done], count: int, before: int, progress: Progress) -> Iterator[Done]:
    """Pass on results, and tell how many there are, with those of earlier runs, and how long the rest takes."""
    begun, failed = time.monotonic(), 0
    for k, (one, rows) in enumerate(results, 1):
        failed += any(row["status"] in FAILED for row in rows)
        left = (time.monotonic() - begun) / k * (count - k)
        earlier = f", {before} of them earlier" if before else ""
        bad = f", {failed} failed" if failed else ""
        progress(f"{before + k} of {before + count} recordings{earlier}{bad}, about {_duration(left)} left")
        yield one, rows


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
