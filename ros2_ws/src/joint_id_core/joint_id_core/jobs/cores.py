"""Several fits on all cores."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

from joint_id_core.errors import JointIdError
from joint_id_core.jobs.fit_job import FitJob, Result
from joint_id_core.options import Progress

Found = TypeVar("Found")  # of one joint


def _one(job: FitJob) -> tuple[str, Result | str]:
    """Fit one joint; return its name and the result, or what was wrong with it."""
    assert job.joint is not None
    try:
        return job.joint, job.run()
    except JointIdError as error:
        return job.joint, str(error)


def run_all(jobs: Sequence[FitJob], progress: Progress = lambda _: None) -> dict[str, Result | str]:
    """Fit several joints on all cores; return by joint the result, or what was wrong with it."""
    return of_all(jobs, _one, progress)


def of_all(jobs: Sequence[FitJob], work: Callable[[FitJob], tuple[str, Found]], progress: Progress) -> dict[str, Found]:
    """Work on several joints on all cores; return by joint what `work`, a function of a module, returns with it."""
    progress(f"fitting {len(jobs)} joints")
    workers = min(len(jobs), os.cpu_count() or 1)
    if workers < 2:
        return dict(_counted(map(work, jobs), len(jobs), progress))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return dict(_counted(pool.map(work, jobs), len(jobs), progress))


def _counted(results: Iterable[tuple[str, Found]], count: int, progress: Progress) -> Iterator[tuple[str, Found]]:
    """Pass on results, and tell how many there are."""
    begun = time.monotonic()
    for k, result in enumerate(results, 1):
        left = (time.monotonic() - begun) / k * (count - k)
        progress(f"{k} of {count} joints, about {left:.0f} s left")
        yield result
