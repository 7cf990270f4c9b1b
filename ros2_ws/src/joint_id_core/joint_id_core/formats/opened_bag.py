"""Open a bag: a directory, a bare file, or a file that was not closed."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import cache
from pathlib import Path
from typing import Any, cast

from rosbags.rosbag2 import Reader

from joint_id_core.errors import JointIdError
from joint_id_core.formats.remote import Place
from joint_id_core.formats.unclosed_bag import UnclosedReader, is_unclosed

log = logging.getLogger(__name__)
Bag = Reader | UnclosedReader


@contextmanager
def opened(path: Place) -> Iterator[Bag]:
    """Open a bag reader; any error of the decoder on damaged bytes becomes one clear JointIdError.

    Of a bag that was not closed, the complete part is read, and a warning is logged.
    """
    try:
        target = _data(path)
        if is_unclosed(target):
            reader: Bag = UnclosedReader(target)
            _warn(path, reader.message_count)
        else:
            reader = Reader(cast(Any, target))  # of a RemotePath it uses what there is
            reader.open()
        with closing(reader):
            if not reader.message_count:
                raise JointIdError(f"{path}: the bag holds no message: record it again while the topics are published")
            yield reader
    except JointIdError:
        raise
    except Exception as error:  # apsw, struct, yaml or rosbags: any of their errors means a damaged file
        if file := _forbidden(path):
            raise JointIdError(f"{file}: no permission to read it: change that (chmod), or copy the bag") from None
        what = " ".join(str(error).split()) or type(error).__name__
        raise JointIdError(
            f"{path}: not a readable bag, damaged or truncated ({what}): record it again, or try `mcap recover` "
            "(mcap) or sqlite's `.recover` (db3)"
        ) from error


def _forbidden(path: Place) -> Path | None:
    """Return a file of a bag that this user may not read; None if there is none."""
    if not isinstance(path, Path):
        return None
    files = path.iterdir() if path.is_dir() else (path,)
    return next((file for file in files if not os.access(file, os.R_OK)), None)


def _data(path: Place) -> Place:
    """Return what to open: the only file of a directory if that file was not closed or metadata.yaml is missing."""
    if not path.is_dir():
        return path
    indexed = (path / "metadata.yaml").exists()
    files: list[Place] = [file for file in sorted(cast(Any, path).iterdir()) if file.suffix in (".mcap", ".db3")]
    if len(files) == 1 and (not indexed or is_unclosed(files[0])):
        return files[0]
    if not indexed:
        several = f" and several files ({', '.join(file.name for file in files)})" if files else ""
        raise JointIdError(
            f"{path}: not a bag, there is no metadata.yaml in it{several}: give a bag directory or a bare .mcap or "
            ".db3 file (`ros2 bag reindex` restores a lost metadata.yaml)"
        )
    return path


@cache  # once for a bag, which a command may open several times
def _warn(path: Place, count: int) -> None:
    log.warning("%s: not closed: %s messages recovered", path, f"{count:,}")
