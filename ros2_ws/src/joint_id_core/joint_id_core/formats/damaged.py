"""A damaged compressed file is told as such: what comes out of it is no table, and its errors would mislead."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from joint_id_core.errors import JointIdError

P = ParamSpec("P")
T = TypeVar("T")
BLOCK = 1 << 20  # bytes that are read together


def tells_damage(function: Callable[Concatenate[Path, P], T]) -> Callable[Concatenate[Path, P], T]:
    """Make a function that reads a file say, in place of its error, that the compressed file is damaged, if it is."""

    @wraps(function)
    def told(path: Path, /, *args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(path, *args, **kwargs)
        except (JointIdError, zlib.error):
            if path.suffix == ".gz" and (why := _damage(path)):
                raise JointIdError(f"{path}: the compressed file is damaged ({why}): copy it again") from None
            raise

    return told


def _damage(path: Path) -> str:
    """Return what is wrong within a compressed file; nothing if it is whole, no such file or only too short."""
    try:
        with gzip.open(path, "rb") as file:
            while file.read(BLOCK):
                pass
    except zlib.error as error:
        return str(error)
    except gzip.BadGzipFile as error:
        return "" if "Not a gzipped file" in str(error) else str(error)
    except (OSError, EOFError):
        pass
    return ""
