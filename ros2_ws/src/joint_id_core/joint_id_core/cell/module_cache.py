"""Compiled modules on disk: found, built once, or borrowed from a cache that cannot be written."""

from __future__ import annotations

import atexit
import errno
import fcntl
import importlib.util
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, TextIO

from joint_id_core.errors import JointIdError

log = logging.getLogger(__name__)

Functions = tuple[Callable[..., Any], ...]  # of a module, that Python calls
CLOSED = (errno.EROFS, errno.EACCES, errno.EPERM)  # errors of a folder that others may not write


def cache_directory() -> Path:
    """Return the folder of the compiled kernels."""
    explicit = os.environ.get("JOINT_ID_CACHE_DIR")
    if explicit:
        return Path(explicit)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "joint_id"


def loaded(path: Path, what: str, source: Callable[[], str], functions: Functions) -> ModuleType:
    """Return a compiled module, from the cache or newly compiled."""
    folder = path.parent
    try:
        lock = _locked(folder)
    except OSError as error:
        if error.errno in CLOSED and path.exists():
            return _borrowed(path, what, source, functions)
        raise JointIdError(
            f"cannot keep compiled kernels in {folder.parent} ({error.strerror}): "
            "set JOINT_ID_CACHE_DIR to a folder that can be written"
        ) from error
    with lock:
        try:
            return _build(path, what, source, functions)
        except Exception as error:  # a new build repairs any problem of a cached file
            log.warning("the cached kernel in %s cannot be loaded (%s): building it again", folder, error)
        try:
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            return _build(path, what, source, functions)
        except OSError as error:
            raise JointIdError(
                f"cannot keep compiled kernels in {folder.parent} ({error.strerror or error}): make space there, or "
                "set JOINT_ID_CACHE_DIR to another folder"
            ) from error


def _borrowed(path: Path, what: str, source: Callable[[], str], functions: Functions) -> ModuleType:
    """Load a module from a cache that cannot be written, from a copy: numba loads nothing where it cannot write."""
    copy = Path(tempfile.mkdtemp(prefix="joint_id_"))
    atexit.register(shutil.rmtree, copy, ignore_errors=True)
    folder = copy / path.parent.name
    shutil.copytree(path.parent, folder)
    for part in (folder, *folder.rglob("*")):
        part.chmod(0o700)
    return _build(folder / path.name, what, source, functions)


def _build(path: Path, what: str, source: Callable[[], str], functions: Functions) -> ModuleType:
    """Load a compiled module; write its source first if it does not exist."""
    if not path.exists():
        log.info("compiling %s once, a few seconds; the result is kept in %s", what, path.parent)
        draft = path.with_suffix(".draft")
        draft.write_text(source())
        draft.replace(path)
    spec = importlib.util.spec_from_file_location(f"joint_id_{path.stem}_{path.parent.name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    with _short_loops_vectorised():
        spec.loader.exec_module(module)
    missing = [f.__name__ for f in functions if not hasattr(module, f.__name__)]
    if missing:  # a file that was truncated by a full disk may still be valid Python
        raise ImportError(f"{path} has no {', '.join(missing)}")
    return module


@contextmanager
def _short_loops_vectorised() -> Iterator[None]:
    """Enable the compiler's vectorisation of unrolled code (SLP), since it unrolls loops over a few columns first.

    It is off by default in numba. With it a pass of the innovations form takes 0.9 of the time, and its noise
    information 0.45.
    """
    from numba import config

    before = config.SLP_VECTORIZE
    config.SLP_VECTORIZE = 1
    try:
        yield
    finally:
        config.SLP_VECTORIZE = before


def _locked(folder: Path) -> TextIO:
    """Create the folder and lock it, so that a second process waits for the build of the first one.

    Raises:
        OSError: the cache cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = folder.with_suffix(".lock").open("w")
    fcntl.flock(lock, fcntl.LOCK_EX)
    return lock
