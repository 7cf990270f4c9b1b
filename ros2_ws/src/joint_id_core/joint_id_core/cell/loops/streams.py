"""What is asked of every batch of samples of a live joint, compiled like `loops.information`.

In NumPy each of these questions takes several calls, which cost more than the answer.
"""

from __future__ import annotations

import math

from joint_id_core.cell.loops.arrays import Vector


def steps(time: Vector, found: Vector) -> None:
    """Write the shortest and the longest step between instants (T,), T > 1, to `found` (2,)."""
    found[0] = math.inf
    found[1] = 0.0
    for t in range(1, len(time)):
        step = time[t] - time[t - 1]
        found[0] = min(found[0], step)
        found[1] = max(found[1], step)


def moving(time: Vector, speed: Vector, before: float, least: float, rest: float, even: float) -> float:
    """Return how many of the first samples at instants (T,) surely belong to no rest of `rest` seconds or longer.

    A sample that is faster than `least` does not, nor do slower ones between two of these that are near to each other.
    So did the sample before, at the instant `before`. A missing speed is no evidence of motion. 0 if the longest step
    is not shorter than `even` times the shortest one.
    """
    count = len(time)
    period = (time[count - 1] - before) / count
    shortest, longest = time[0] - before, time[0] - before
    for t in range(1, count):
        shortest, longest = min(shortest, time[t] - time[t - 1]), max(longest, time[t] - time[t - 1])
    if not longest < even * shortest:
        return 0.0
    sure = 0
    for t in range(count):
        if (t + 1 - sure) * period > rest:
            break
        if abs(speed[t]) > least:
            sure = t + 1
    return 1.0 * sure


def always_moves(values: Vector, count: int, least: float) -> float:
    """Return 1 if the first and the last of any `count` consecutive values (T,) differ by more than `least`, else 0.

    A missing value is no evidence of motion: 0.
    """
    for t in range(len(values) - count + 1):
        if not abs(values[t + count - 1] - values[t]) > least:
            return 0.0
    for t in range(len(values)):
        if math.isnan(values[t]):
            return 0.0
    return 1.0
