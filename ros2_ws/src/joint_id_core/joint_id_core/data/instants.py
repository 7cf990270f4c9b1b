"""Conversion between instants in integer nanoseconds and times in s since a nearby origin."""

from __future__ import annotations

import math

NANO = 10**9


def seconds(instant_ns: int, origin_ns: int) -> float:
    """Return the time since an origin in s; for less than a day a double keeps every nanosecond."""
    return (instant_ns - origin_ns) / NANO


def instant(time_s: float, origin_ns: int) -> int:
    """Return the instant in ns of a time in s since an origin (inverse of `seconds`); the origin for NaN."""
    return origin_ns + (round(time_s * NANO) if math.isfinite(time_s) else 0)
