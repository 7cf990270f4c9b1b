"""Instants in whole nanoseconds, and times in seconds that count from an origin near them."""

from __future__ import annotations

import math

NANO = 10**9


def seconds(instant_ns: int, origin_ns: int) -> float:
    """Time since an origin in s; near zero, so that a double keeps every nanosecond of a day."""
    return (instant_ns - origin_ns) / NANO


def instant(time_s: float, origin_ns: int) -> int:
    """Inverse of `seconds`; the origin for a time that is not known."""
    return origin_ns + (round(time_s * NANO) if math.isfinite(time_s) else 0)
