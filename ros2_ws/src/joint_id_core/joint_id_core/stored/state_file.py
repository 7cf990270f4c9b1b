"""The file in which the identifier keeps what it knows of the joints, so that the end of the process loses nothing.

One JSON file: format, version, wall-clock time of writing, and per joint the newest good estimate with the settings
under which it was made. A checksum finds a file that was changed or copied badly.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from joint_id_core.errors import JointIdError
from joint_id_core.results.estimate import Estimate

FORMAT = "joint_id knowledge"
VERSION = 1  # increased when a reader of the previous version would misread a file


@dataclass(frozen=True)
class Known:
    """What is known of one joint.

    Attributes:
        estimate: newest good estimate; its times count from `origin_ns`.
        origin_ns: instant in ns on the clock of the samples.
        watched_s: wall-clock time, in s since 1970, until which the estimate was known to hold.
        settings: `settings` of the identifier that made it.
    """

    estimate: Estimate
    origin_ns: int
    watched_s: float
    settings: Mapping[str, Any]


class StateFile:
    """Reads and writes the file; it is never half written, and one that cannot be read is kept under another name."""

    def __init__(self, path: str) -> None:
        self.path = Path(path).expanduser().absolute()
        self._precious = False  # whether there is a file that could be neither read nor renamed

    def read(self) -> dict[str, Known]:
        """Return what is known, by joint; nothing if there is no file.

        Raises:
            JointIdError: the file cannot be read, or is no such file, damaged, or of a later version. It then has
                another name, which the message gives.
        """
        self._precious = False
        try:
            content = self.path.read_bytes()
        except FileNotFoundError:
            return {}
        except OSError as error:
            self._precious = True
            raise JointIdError(
                f"state file {self.path} cannot be read: {error.strerror}: mend that and call ~/load"
            ) from None
        try:
            return _parsed(content)
        except JointIdError as error:
            raise JointIdError(f"state file {self.path}: {error}. {self._set_aside()}") from None

    def write(self, known: Mapping[str, Known], now_s: float) -> None:
        """Replace the file at once.

        Raises:
            JointIdError: it cannot be written; the old one is as it was.
        """
        joints = {
            name: {
                "estimate": one.estimate.to_dict(),
                "origin_ns": one.origin_ns,
                "watched_s": one.watched_s,
                "settings": dict(one.settings),
            }
            for name, one in sorted(known.items())
        }
        head = {"format": FORMAT, "version": VERSION, "written_s": now_s, "sha256": _checksum(joints)}
        lost = "what is known is lost if the node ends"
        if self._precious:
            raise JointIdError(f"state file {self.path} is not overwritten, as it could not be read: {lost}")
        try:
            text = json.dumps({**head, "joints": joints}, allow_nan=False) + "\n"
            _replace(self.path, self._beside(".part"), text.encode())
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else str(error)
            raise JointIdError(f"state file {self.path} cannot be written: {why}: {lost}") from None

    def remove(self) -> None:
        """Delete the file, if there is one.

        Raises:
            JointIdError: it cannot be deleted.
        """
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise JointIdError(f"state file {self.path} cannot be deleted: {error.strerror}") from None
        self._precious = False

    def _beside(self, ending: str) -> Path:
        return self.path.with_name(self.path.name + ending)

    def _set_aside(self) -> str:
        """Give the file a name under which nobody overwrites it; return a sentence on what became of it."""
        number, kept = 1, self._beside(".damaged")
        while kept.exists():
            number += 1
            kept = self._beside(f".damaged{number}")
        try:
            self.path.rename(kept)
        except OSError as error:
            self._precious = True
            return f"It cannot be renamed ({error.strerror}): move it away and call ~/load"
        return f"It is kept as {kept}, and identification starts anew"


def _parsed(content: bytes) -> dict[str, Known]:
    """Return what a file holds."""
    try:
        top = json.loads(content)
    except ValueError as error:  # not JSON, or not even text
        raise JointIdError(f"it is damaged: {error}") from None
    if not isinstance(top, dict) or top.get("format") != FORMAT:
        raise JointIdError(f'it is no state file: "format" is not "{FORMAT}"')
    if not isinstance(version := top.get("version"), int) or version > VERSION:
        raise JointIdError(f"it is of version {version}, and this node reads up to {VERSION}: update joint_id")
    joints = top.get("joints")
    if not isinstance(joints, dict) or _checksum(joints) != top.get("sha256"):
        raise JointIdError("it is damaged: its checksum is another one")
    try:
        return {
            name: Known(
                Estimate.from_dict(one["estimate"]), int(one["origin_ns"]), float(one["watched_s"]), one["settings"]
            )
            for name, one in joints.items()
        }
    except (KeyError, TypeError, ValueError) as error:
        raise JointIdError(f"it is damaged: {type(error).__name__}: {error}") from None


def _checksum(joints: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(joints, sort_keys=True).encode()).hexdigest()


def _replace(path: Path, draft: Path, content: bytes) -> None:
    """Put a file in place of another one at once, so that it is whole after a power cut too."""
    handle = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError:
        draft.unlink(missing_ok=True)  # a full disk needs its room
        raise
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
