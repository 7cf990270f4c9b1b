"""Types of the arguments of public functions."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from joint_id_core.errors import JointIdError


def require_type(what: str, value: object, kinds: type | tuple[type, ...], advice: str) -> None:
    """Check the type of an argument; `advice` says how to get the right one.

    Raises:
        JointIdError: it is of another type.
    """
    if not isinstance(value, kinds):
        raise JointIdError(f"{what} is {value!r:.60}, of type {type(value).__name__}: {advice}")


def file_path(path: object) -> Path:
    """Return the path of a file.

    Raises:
        JointIdError: it is neither a text nor a path.
    """
    require_type("path", path, (str, PathLike), "give the name of a file")
    return Path(path)  # type: ignore[arg-type]  # checked above
