"""Files and folders in object storage or on a web server, through fsspec: `s3://bucket/bag.mcap`, `https://host/a.csv`.

Keys, rights and addresses of the storage come from its own settings (environment, configuration of fsspec).
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import total_ordering
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeAlias

from joint_id_core.arguments import require_type
from joint_id_core.errors import JointIdError

# Bytes that are read ahead: an mcap file is read in small steps where its index is, else in chunks of about 1 MB.
READ_AHEAD = 2**16


class Size(NamedTuple):
    """What `RemotePath.stat` returns."""

    st_size: int


def is_url(text: str) -> bool:
    """Return whether a text is an address, such as s3://bucket/file.mcap, and no path of this computer."""
    return "://" in text


def library() -> ModuleType:
    """Return fsspec.

    Raises:
        JointIdError: it is not installed.
    """
    try:
        import fsspec
    except ModuleNotFoundError:
        raise JointIdError("addresses such as s3://bucket/file need the package fsspec: pip install fsspec") from None
    return fsspec


@contextmanager
def told(url: str, what: str = "cannot be read") -> Iterator[None]:
    """Turn any error of a storage into one line that names the address."""
    try:
        yield
    except JointIdError:
        raise
    except FileNotFoundError:
        raise JointIdError(f"{url}: {what}: no such file, folder or bucket: check the address") from None
    except PermissionError as error:
        raise JointIdError(f"{url}: {what}, access denied ({error}): check keys and rights") from None
    except ModuleNotFoundError as error:
        raise JointIdError(f"{url}: {what}: {error}: install that package (s3 needs: pip install s3fs)") from None
    except ImportError as error:  # fsspec says which package to install
        raise JointIdError(f"{url}: {what}: {error}") from None
    except Exception as error:  # each storage has its own kinds of errors
        said = " ".join(str(error).split()) or type(error).__name__
        raise JointIdError(f"{url}: {what} ({said}): check address, keys and network") from None


@total_ordering
class RemotePath:
    """An address, with those attributes of `pathlib.Path` that the readers of bags use.

    Raises:
        JointIdError: from every method, the storage cannot be reached, or refuses.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self.name = self.url.rpartition("/")[2]
        dot = self.name.rfind(".")
        self.suffix = self.name[dot:] if dot > 0 else ""
        with told(url):
            self.files, self.path = library().core.url_to_fs(self.url)

    def __reduce__(self) -> Any:
        return RemotePath, (self.url,)

    def __str__(self) -> str:
        return self.url

    def __repr__(self) -> str:
        return f"RemotePath({self.url!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RemotePath) and other.url == self.url

    def __lt__(self, other: RemotePath) -> bool:
        return self.url < other.url

    def __hash__(self) -> int:
        return hash(self.url)

    def __truediv__(self, name: Any) -> RemotePath:
        return RemotePath(f"{self.url}/{name}")

    def exists(self) -> bool:
        """Return whether there is a file or folder."""
        with told(self.url):
            return bool(self.files.exists(self.path))

    def is_dir(self) -> bool:
        """Return whether it is a folder; a web server has none."""
        if self.url.startswith(("http://", "https://")):
            return False
        with told(self.url):
            return bool(self.files.isdir(self.path))

    def stat(self) -> Size:
        """Return its size in bytes."""
        with told(self.url):
            return Size(int(self.files.size(self.path) or 0))

    def iterdir(self) -> Iterator[RemotePath]:
        """Yield what is in the folder."""
        with told(self.url):
            found = self.files.ls(self.path, detail=False)
        yield from (self / name.rstrip("/").rpartition("/")[2] for name in found)

    def open(self, mode: str = "rb") -> _File:
        """Open the file; only what is asked for is read, and `READ_AHEAD` bytes more."""
        with told(self.url):
            return _File(self.url, self.files.open(self.path, mode, block_size=READ_AHEAD, cache_type="readahead"))

    def read_text(self, encoding: str = "utf-8") -> str:
        """Return the content of a text file."""
        with told(self.url):
            return str(self.files.cat_file(self.path).decode(encoding))


Place: TypeAlias = Path | RemotePath


class _File(io.RawIOBase):
    """An open file whose errors name its address, and are not taken for a damaged recording."""

    def __init__(self, url: str, file: Any) -> None:
        self._url, self._file = url, file

    def read(self, size: int = -1) -> bytes:
        with told(self._url):
            return bytes(self._file.read(size))

    def seek(self, offset: int, whence: int = 0) -> int:
        with told(self._url):
            return int(self._file.seek(offset, whence))

    def tell(self) -> int:
        return int(self._file.tell())

    def close(self) -> None:
        if not self.closed:
            self._file.close()
        super().close()


def place(path: str | Place) -> Place:
    """Return a path, or an address where the text is one.

    Raises:
        JointIdError: it is of another type.
    """
    if isinstance(path, RemotePath):
        return path
    require_type("path", path, (str, PathLike), "give the name of a file")
    return RemotePath(path) if isinstance(path, str) and is_url(path) else Path(path)


@contextmanager
def copied(path: RemotePath) -> Iterator[Path]:
    """Copy a file or folder here, for a reader that needs all of it; errors name the address and not the copy."""
    with tempfile.TemporaryDirectory(prefix="joint_id_") as folder:
        here = Path(folder) / path.name
        with told(path.url):
            path.files.get(path.path, str(here), recursive=path.is_dir())
        try:
            yield here
        except JointIdError as error:
            raise JointIdError(str(error).replace(str(here), path.url)) from None
