"""Times of calls that are compared: on one core, in turn, as wall time and as processor time.

On a machine that does other work as well wall time is longer than processor time, and both change from one second to
the next (clock rate, caches). Calls that are compared take turns, so that what slows one slows the others.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


@dataclass(frozen=True)
class Times:
    """What a call takes, in s."""

    wall_s: float
    cpu_s: float

    @staticmethod
    def median(times: Iterable[Times]) -> Times:
        """Medians of both kinds."""
        wall, cpu = zip(*((t.wall_s, t.cpu_s) for t in times), strict=True)
        return Times(float(np.median(wall)), float(np.median(cpu)))

    def between(self, other: Times, share: float) -> Times:
        """On the straight line from these times (share 0) to others (share 1)."""
        wall, cpu = (a + share * (b - a) for a, b in ((self.wall_s, other.wall_s), (self.cpu_s, other.cpu_s)))
        return Times(wall, cpu)


def once(call: Callable[[], T]) -> tuple[T, Times]:
    """What a call returns, and its time."""
    cpu, wall = time.process_time(), time.perf_counter()
    result = call()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return result, Times(wall, cpu)


def in_turn(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Times]:
    """Median time of each call over `rounds` in which all take turns, after one that does not count."""
    for call in calls.values():
        call()
    found: dict[str, list[Times]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            found[name].append(once(call)[1])
    return {name: Times.median(times) for name, times in found.items()}


def keep_to_one_core() -> None:
    """Bind this process to one of its cores."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def alone(function: Callable[..., T], *arguments: Any) -> T:
    """Result of a function of a module, in a fresh process on one core."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, keep_to_one_core) as pool:
        return pool.submit(function, *arguments).result()
