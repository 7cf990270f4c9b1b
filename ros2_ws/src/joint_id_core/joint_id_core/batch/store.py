"""Where a table is kept: a file on this computer or in object storage, and beside it a folder of finished parts.

A part is written whole or not at all: here under another name first, in object storage because an upload is. So a
process that is killed while it writes leaves no half part.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from joint_id_core.errors import JointIdError
from joint_id_core.formats.remote import RemotePath, is_url, told

PARTS = ".parts"  # ending of the folder, after the name of the table
ENDING = ".json"  # of a part
DRAFT = ".draft"  # ending of what is not complete yet
ASIDE = ".damaged"


class Store(Protocol):
    """A table and its parts.

    Raises:
        JointIdError: from every method, the place cannot be read or written.
    """

    name: str

    def locked(self) -> Any:
        """Return a context in which no other process of this computer writes this table."""

    def table(self) -> BinaryIO | None:
        """Open the table; None if there is none."""

    def draft(self) -> Any:
        """Return a context with the path of a new table, which replaces the old one at its end."""

    def parts(self) -> list[str]:
        """Return the names of the parts."""

    def get(self, part: str) -> bytes:
        """Read a part."""

    def put(self, part: str, content: bytes) -> None:
        """Write a part, whole or not at all."""

    def set_aside(self, part: str = "") -> str:
        """Rename a part, or the table; return the new name."""

    def clear(self) -> None:
        """Remove the parts, which are in the table."""


def store(output: str) -> Store:
    """Return the store of a path or an address."""
    return RemoteStore(output) if is_url(output) else LocalStore(output)


class LocalStore:
    """A `Store` on this computer; methods as there."""

    def __init__(self, output: str) -> None:
        self.name = output
        self._table = Path(output)
        self._folder = Path(output + PARTS)
        if self._table.is_dir():
            raise JointIdError(f"{output} is a folder: give the name of a file, such as results.parquet")

    @contextmanager
    def locked(self) -> Iterator[None]:
        with _said(self.name):
            self._folder.mkdir(exist_ok=True)
            file = (self._folder / "lock").open("w")
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise JointIdError(
                    f"{self.name} is being written by another process: wait for it, or give another -o"
                ) from None
            yield

    def table(self) -> BinaryIO | None:
        with _said(self.name):
            return self._table.open("rb") if self._table.exists() else None

    @contextmanager
    def draft(self) -> Iterator[str]:
        draft = self._table.with_name(self._table.name + DRAFT)
        with _said(self.name):
            try:
                yield str(draft)
                _to_disk(draft)
                draft.replace(self._table)
            except BaseException:
                draft.unlink(missing_ok=True)
                raise

    def parts(self) -> list[str]:
        with _said(self.name):
            if not self._folder.exists():
                return []
            return sorted(entry.name for entry in os.scandir(self._folder) if entry.name.endswith(ENDING))

    def get(self, part: str) -> bytes:
        with _said(self.name):
            return (self._folder / part).read_bytes()

    def put(self, part: str, content: bytes) -> None:
        draft = self._folder / (part + DRAFT)
        with _said(self.name):
            draft.write_bytes(content)
            _to_disk(draft)
            draft.replace(self._folder / part)

    def set_aside(self, part: str = "") -> str:
        path = self._folder / part if part else self._table
        with _said(self.name):
            number = 0
            while (aside := path.with_name(f"{path.name}{ASIDE}{f'-{number}' if number else ''}")).exists():
                number += 1
            path.rename(aside)
        return str(aside)

    def clear(self) -> None:
        with _said(self.name):
            for entry in list(os.scandir(self._folder)):
                if entry.name.endswith((ENDING, DRAFT)) or entry.name == "lock":
                    os.unlink(entry)
            if not any(os.scandir(self._folder)):  # else something was set aside there
                self._folder.rmdir()


class RemoteStore:
    """A `Store` in object storage; methods as there."""

    def __init__(self, output: str) -> None:
        self.name = output
        place = RemotePath(output)
        self._files, self._table = place.files, place.path
        self._folder = self._table + PARTS

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Return a context that only checks the rights: object storage has no locks, and parts are the same for all."""
        with told(self.name, "cannot be written"):
            self._files.pipe_file(f"{self._folder}/lock", b"")
        yield

    def table(self) -> BinaryIO | None:
        with told(self.name):
            self._files.invalidate_cache()
            return self._files.open(self._table, "rb") if self._files.exists(self._table) else None

    @contextmanager
    def draft(self) -> Iterator[str]:
        with tempfile.TemporaryDirectory(prefix="joint_id_") as folder:
            draft = Path(folder) / "table.parquet"
            yield str(draft)
            with told(self.name, "cannot be written"):
                self._files.put_file(str(draft), self._table)

    def parts(self) -> list[str]:
        with told(self.name):
            self._files.invalidate_cache()
            found = self._files.ls(self._folder, detail=False)
        names = (name.rpartition("/")[2] for name in found)
        return sorted(name for name in names if name.endswith(ENDING))

    def get(self, part: str) -> bytes:
        with told(self.name):
            return bytes(self._files.cat_file(f"{self._folder}/{part}"))

    def put(self, part: str, content: bytes) -> None:
        with told(self.name, "cannot be written"):
            self._files.pipe_file(f"{self._folder}/{part}", content)

    def set_aside(self, part: str = "") -> str:
        path = f"{self._folder}/{part}" if part else self._table
        with told(self.name, "cannot be renamed"):
            number = 0
            while self._files.exists(aside := f"{path}{ASIDE}{f'-{number}' if number else ''}"):
                number += 1
            self._files.mv(path, aside)
        return str(self._files.unstrip_protocol(aside))

    def clear(self) -> None:
        with told(self.name, "cannot be cleared"):
            self._files.invalidate_cache()
            names = self._files.ls(self._folder, detail=False)
            done = [n for n in names if n.endswith(ENDING) or n.endswith("/lock")]
            if done:
                self._files.rm(done)


@contextmanager
def _said(name: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise JointIdError(
            f"{name}: cannot be read or written ({error.strerror or error}): check folder, rights and space"
        ) from None


def _to_disk(path: Path) -> None:
    """Make a file outlive a failure of the power."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
