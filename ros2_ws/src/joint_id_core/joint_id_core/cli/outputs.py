"""Files of a command: none is read twice, and none that is written may be one that is read."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from joint_id_core.errors import JointIdError


def require_apart(outputs: Mapping[str, Path | None], inputs: Iterable[Path | None]) -> None:
    """Check that what is written, by option, is no input and no other output.

    Raises:
        JointIdError: it is.
    """
    taken = {_place(path): "is read by this command" for path in inputs if path is not None}
    for option, path in outputs.items():
        if path is None:
            continue
        place = _place(path)
        if place in taken:
            raise JointIdError(f"{option} {path} would overwrite a file that {taken[place]}: give another name")
        if place.exists() and not place.is_file():
            continue  # a device: it may be given twice
        taken[place] = f"{option} writes"


def require_different(files: Sequence[Path]) -> None:
    """Check that no recording is given twice: it would count as two.

    Raises:
        JointIdError: one is.
    """
    places = [_place(file) for file in files]
    for k, place in enumerate(places):
        if place in places[:k]:
            raise JointIdError(f"{files[k]} is given twice, and would count as two recordings: give it once")


def require_unseen(validate: Path | None, files: Sequence[Path]) -> None:
    """Check that the recording to validate with is none of those that are fitted.

    Raises:
        JointIdError: it is.
    """
    if validate is not None and _place(validate) in map(_place, files):
        raise JointIdError(f"--validate {validate}: the same recording is no test of its fit: give another one")


def _place(path: Path) -> Path:
    """Return where a path leads; a link that leads to itself is its own place, and is missed when it is read."""
    return Path(os.path.realpath(path))
