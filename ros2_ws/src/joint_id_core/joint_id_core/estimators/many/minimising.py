"""Many searches for a minimum at once: each iterates as a fit does, and all of them share their passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Cost, Iteration, Minimum, iterations
from joint_id_core.estimators.innovations.noise import NoiseScoring
from joint_id_core.estimators.many.passes import Passes
from joint_id_core.options import Progress

TOGETHER = 10000  # searches that run at the same time; more wait: each keeps its last pass, some kB


@dataclass(frozen=True)
class Start:
    """Where one search begins.

    Attributes:
        record: index of its record among those of the `Passes`.
        cost: what it minimises: the record with a prior.
        noise: scoring of the record's noise levels.
        z: start coordinates, shape (k,).
        levels: start variances of the noise, shape (L,).
    """

    record: int
    cost: Cost
    noise: NoiseScoring
    z: Array
    levels: Array


def minimised(
    passes: Passes,
    starts: Sequence[Start],
    substeps: Sequence[int],
    tolerance: float,
    max_iterations: int,
    tell: Progress = lambda _: None,
) -> list[Minimum | None]:
    """Fit parameters and noise levels from every start: see `gauss_newton.iterations`.

    Args:
        passes: runs the passes.
        starts: where to begin.
        substeps: integrator steps per sample of each record.
        tolerance, max_iterations: of each search.
        tell: called with a line of text from time to time.

    Returns:
        The end of each search, at a point whose pass is known; None where the start gives no finite cost.
    """
    ends: list[Minimum | None] = []
    for first in range(0, len(starts), TOGETHER):
        part = starts[first : first + TOGETHER]
        ends += _together(
            passes, part, substeps, tolerance, max_iterations, tell, f"{first} of {len(starts)} starts done"
        )
    return ends


def _together(
    passes: Passes,
    starts: Sequence[Start],
    substeps: Sequence[int],
    tolerance: float,
    max_iterations: int,
    tell: Progress,
    done: str,
) -> list[Minimum | None]:
    ends: list[Minimum | None] = [None] * len(starts)
    searches: dict[int, Iteration] = {}
    asked: dict[int, tuple[Array, Array]] = {}
    begun = _points(passes, starts, {i: (s.z, s.levels) for i, s in enumerate(starts)}, substeps)
    for i, point in begun.items():
        if point is not None:
            s = starts[i]
            searches[i] = iterations(s.cost, point, tolerance, max_iterations, s.noise)
            _advance(searches, ends, asked, i, None)
    while asked:
        tell(f"{done}, {len(asked)} under way")
        points = _points(passes, starts, asked, substeps)
        asked = {}
        for i, point in points.items():
            _advance(searches, ends, asked, i, point)
    # the last step of a search is taken without another pass: run it, so that costs can be compared
    last = {i: (end.z, end.levels) for i, end in enumerate(ends) if end is not None}
    for i, point in _points(passes, starts, last, substeps).items():
        end = ends[i]
        if end is not None and point is not None:
            ends[i] = _with_search(point, end)
    return ends


def _with_search(point: Minimum, end: Minimum) -> Minimum:
    """Return the point with what the search that ended there says of itself."""
    return replace(point, settled=end.settled, iterations=end.iterations, left=end.left)


def _advance(
    searches: dict[int, Iteration],
    ends: list[Minimum | None],
    asked: dict[int, tuple[Array, Array]],
    i: int,
    point: Minimum | None,
) -> None:
    """Let search i go on with the point that it asked for, until it asks for the next one or ends."""
    try:
        asked[i] = searches[i].send(point)
    except StopIteration as end:
        ends[i] = end.value
        del searches[i]


def _points(
    passes: Passes, starts: Sequence[Start], at: dict[int, tuple[Array, Array]], substeps: Sequence[int]
) -> dict[int, Minimum | None]:
    """Run one pass for each of the points `at`, by index of the start."""
    if not at:
        return {}
    chosen = [starts[i] for i in at]
    record = np.array([s.record for s in chosen], dtype=np.int64)
    free = np.array([s.cost.coordinates.values(z) for s, (z, _) in zip(chosen, at.values(), strict=True)])
    found = passes.run(record, free, np.array([levels for _, levels in at.values()]))
    return {
        i: s.cost.after(z, last, substeps[s.record])
        for (i, (z, _)), s, last in zip(at.items(), chosen, found, strict=True)
    }
