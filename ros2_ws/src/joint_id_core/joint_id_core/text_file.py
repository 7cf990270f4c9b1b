"""Write a file whole, or not at all, and check before long work that it can be."""

from __future__ import annotations

from pathlib import Path

from joint_id_core.errors import JointIdError


def write_text(path: Path, text: str, what: str) -> None:
    """Write a text in UTF-8, as `write_bytes`. Parts of a file name that are no characters become question marks.

    Raises:
        JointIdError: as `write_bytes`.
    """
    write_bytes(path, text.encode(errors="replace"), what)


def write_bytes(path: Path, content: bytes, what: str) -> None:
    """Write a file. One that is there is replaced only after the new one is complete; a link stays one.

    `what` says in the error what could not be written, e.g. "the estimate".

    Raises:
        JointIdError: the file cannot be written; nothing is left of it.
    """
    try:
        path = path.resolve() if path.is_symlink() else path
        if path.exists() and not path.is_file():  # a device or a pipe, or a folder, which is an error
            path.write_bytes(content)
            return
        draft = path.with_name(path.name + ".part")
        try:
            draft.write_bytes(content)
            draft.replace(path)
        except OSError:
            draft.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise _not_written(path, what, error) from None


def require_writable(path: Path, what: str) -> None:
    """Check that a text can be written, as by `write_text`; nothing is left where no file was.

    Raises:
        JointIdError: it cannot.
    """
    try:
        path = path.resolve() if path.is_symlink() else path
        existed = path.exists()
        if existed and not path.is_file() and not path.is_dir():
            return  # a pipe that is opened and closed has ended for its reader
        path.open("a").close()
        if not existed:
            path.unlink()
    except OSError as error:
        raise _not_written(path, what, error) from None


def _not_written(path: Path, what: str, error: OSError) -> JointIdError:
    return JointIdError(f"{path}: {what} cannot be written: {error.strerror}: check folder, permissions and space")
