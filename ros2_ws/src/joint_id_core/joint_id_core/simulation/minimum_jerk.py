"""The smoothest way from one place to another (Flash and Hogan, J. Neurosci. 5, 1985, eq. 3)."""

from __future__ import annotations

from typing import TypeVar

from joint_id_core.data.recording import Array

T = TypeVar("T", float, Array)


def minimum_jerk(x: T) -> tuple[T, T]:
    """Return the share of the way and its derivative, at the share `x` of the time, from 0 to 1."""
    y = 1.0 - x
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * y * y
