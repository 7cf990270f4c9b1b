"""Runs of all cases, in processes of their own."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

from online.cases import Case
from online.joints import joint
from online.records import records
from online.watching import Outcome, outcome


def watched(model: str, motion: str, seed: int, cases: Sequence[Case]) -> list[Outcome]:
    """Outcomes of the cases that make sense for a model."""
    it = joint(model)
    possible = [c for c in cases if c.part not in it.lacks]
    return [
        outcome(it, case.name, motion, seed, record, bool(case.fault))
        for case, record in records(it, motion, seed, possible)
    ]


def spread(function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]], workers: int) -> Iterator[Any]:
    """Results of a function for many tuples of arguments, in the order in which they are ready."""
    if workers == 1:
        yield from (function(*task) for task in tasks)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(function, *task) for task in tasks]):
            yield done.result()
