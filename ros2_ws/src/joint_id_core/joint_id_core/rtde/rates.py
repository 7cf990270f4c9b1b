"""Rates at which a controller sends: its largest rate divided by a whole number."""

from __future__ import annotations

import math
from collections.abc import Sequence

from joint_id_core.rtde.errors import RefusedError

LARGEST_HZ, LARGEST_HZ_CB3 = 500.0, 125.0
_E_SERIES = 5  # first major version of the controllers after CB3

_CLOSE = 1e-4  # relative tolerance: 166.67 means 500 / 3


def sent_rate(asked: float, version: Sequence[int]) -> float:
    """Return the rate in Hz to request from a controller of this version (major, minor, ...) to get the rate `asked`.

    The controller sends at its largest rate over floor(largest / requested). So with a third of the largest rate,
    rounded up, it would send at a half.

    Raises:
        RefusedError: a rate at which it does not send; the message names the nearest ones.
    """
    largest = LARGEST_HZ if version[0] >= _E_SERIES else LARGEST_HZ_CB3
    every = max(1, round(largest / asked))
    rate = largest / every
    if abs(rate - asked) > _CLOSE * asked:
        below = math.ceil(largest / asked)
        nearest = [largest / n for n in (below - 1, below) if n >= 1]
        raise RefusedError(
            f"rate {asked:g} Hz: a controller of version {version[0]} sends at {largest:g} Hz over a whole number: "
            f"choose {' or '.join(f'{hz:g}' for hz in nearest)}"
        )
    while math.floor(largest / rate) < every:  # 500 / (500 / 15) is a bit less than 15
        rate = math.nextafter(rate, 0.0)
    return rate
