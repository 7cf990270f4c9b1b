"""Versions of what an estimate depends on."""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("joint-id-core", "numpy", "scipy", "numba")


@cache
def versions() -> str:
    """Return them in words."""
    return ", ".join([*(f"{name} {_version(name)}" for name in PACKAGES), f"python {platform.python_version()}"])


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # run from its source
        return "unknown"
