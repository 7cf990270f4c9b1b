"""Search among shapes of motions: random ones, then small random steps from the best one.

The steps are those of a (1+1) evolution strategy with a step that grows after a success (Rechenberg,
Evolutionsstrategie, 1973). What a shape is, and what it is worth, is said by others: `fourier_shapes`,
`waypoint_shapes`, `search`, `arm_waypoints`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numpy as np

from joint_id_core.options import Progress

FIRST_STEP, LEAST_STEP, MORE, LESS = 0.4, 0.05, 1.5, 0.9  # of the changes, relative to what is changed

S = TypeVar("S")  # a shape
S_co = TypeVar("S_co", covariant=True)


class Kind(Protocol[S]):
    """A kind of shapes."""

    def random(self, rng: np.random.Generator) -> S:
        """Return a shape at random."""

    def changed(self, shape: S, size: float, rng: np.random.Generator) -> S:
        """Return a shape that differs by a step of this relative size."""


class Rated(Protocol[S_co]):
    """A shape of which is known what it is worth."""

    @property
    def shape(self) -> S_co:
        """The shape."""


C = TypeVar("C", bound=Rated[Any])


def drawn(
    kind: Kind[S], better: Callable[[S, C | None], C | None], count: int, rng: np.random.Generator, progress: Progress
) -> C | None:
    """Return the best of random shapes; None if none can be rated.

    Args:
        kind: of the shapes.
        better: returns a shape as rated if it is better than the best one, else the best one.
        count: of shapes.
        rng: random numbers.
        progress: called with the number of each shape, from 1 on, as a text.
    """
    best: C | None = None
    for k in range(count):
        progress(str(k + 1))
        best = better(kind.random(rng), best)
    return best


def evolved(
    kind: Kind[S], best: C, better: Callable[[S, C], C], count: int, rng: np.random.Generator, progress: Progress
) -> C:
    """Return the best shape that steps from a good one lead to; arguments as those of `drawn`."""
    size = FIRST_STEP
    for k in range(count):
        progress(str(k + 1))
        found = better(kind.changed(best.shape, size, rng), best)
        size = min(1.0, size * MORE) if found is not best else max(LEAST_STEP, size * LESS)
        best = found
    return best
