"""Find the recordings that patterns stand for, on this computer or in object storage."""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from joint_id_core.batch.pattern import expression, fixed_part, for_glob, is_pattern
from joint_id_core.errors import JointIdError
from joint_id_core.formats import KINDS
from joint_id_core.formats.remote import RemotePath, is_url, told

INDEX = "metadata.yaml"  # of a bag, which is a folder
BAG_ENDINGS = (".mcap", ".db3")
WEB = ("http://", "https://")
CHANGED = (
    "ETag",
    "etag",
    "LastModified",
    "last_modified",
    "mtime",
    "created",
)  # of a version of a file


@dataclass(frozen=True)
class Found:
    """A recording: absolute path or address, what the pattern says of it, size and time (or version) of its files."""

    place: str
    size_bytes: int
    modified: str
    robot: str = ""
    joint: str = ""


def find(patterns: Sequence[str]) -> list[Found]:
    """Return the recordings of all patterns, each once, in the order of their places.

    A bag in a folder with its index is one recording, also where the pattern matches a file in it. A folder without an
    index stands for all recordings in it. Files of other kinds are left out.

    Raises:
        JointIdError: a pattern that matches no recording, or a storage that cannot be reached or refuses.
    """
    found: dict[str, Found] = {}
    for pattern in patterns:
        here = {one.place: one for one in (_remote(pattern) if is_url(pattern) else _local(pattern))}
        if not here:
            there = is_url(pattern) or is_pattern(pattern) or Path(pattern).exists()
            what = "matches no recording" if there else "no such file or folder"
            raise JointIdError(f"{pattern}: {what} ({', '.join(KINDS)} or a bag folder): check the path")
        for place, one in here.items():
            known = found.get(place, one)  # a second pattern may say more
            found[place] = replace(known, robot=known.robot or one.robot, joint=known.joint or one.joint)
    return [found[place] for place in sorted(found)]


def _is_recording(name: str) -> bool:
    return any(name.lower().removesuffix(".gz").endswith(ending) for ending in KINDS)


def _local(pattern: str) -> Iterator[Found]:
    literal = Path(pattern).exists()
    matched = [pattern] if literal else sorted(glob.glob(for_glob(pattern), recursive=True))
    names = expression(pattern)
    for text in matched:
        says = None if literal else names.fullmatch(text)
        for path in _recordings(Path(text)):
            files = [path] if path.is_file() else [p for p in sorted(path.rglob("*")) if p.is_file()]
            stats = [file.stat() for file in files]
            changed = max((s.st_mtime for s in stats), default=0.0)
            when = datetime.fromtimestamp(changed, UTC).isoformat()
            size = sum(s.st_size for s in stats)
            yield Found(os.path.abspath(path), size, when, **(says.groupdict() if says else {}))


def _recordings(path: Path) -> Iterator[Path]:
    """Yield what a path stands for: itself, the bag that it is a file of, or the recordings in a folder."""
    if path.is_dir():
        if (path / INDEX).exists():
            yield path
        else:
            for file in sorted(path.rglob("*")):
                if file.suffix.lower() != ".txt" and file.is_file():  # notes, more often than recordings
                    yield from _recordings(file)
    elif path.suffix.lower() in BAG_ENDINGS and (path.parent / INDEX).exists():
        yield path.parent
    elif _is_recording(path.name):
        yield path


def _remote(pattern: str) -> Iterator[Found]:
    if pattern.startswith(WEB):  # it lists no files, and ? is a part of addresses
        path = RemotePath(pattern)
        with told(pattern):
            info = path.files.info(path.path)
        yield Found(pattern, int(info.get("size") or 0), _version([info]))
        return
    for_glob(pattern)  # says which names are not known
    root = RemotePath(fixed_part(pattern))
    with told(pattern):
        listed = root.files.find(root.path, detail=True)
    files = {str(root.files.unstrip_protocol(name)): info for name, info in listed.items()}
    folders = {url.rpartition("/")[0] for url in files if url.endswith(f"/{INDEX}")}
    names = expression(str(root.files.unstrip_protocol(RemotePath(pattern).path)))
    bags: dict[str, list[Mapping[str, Any]]] = {}
    for url, info in files.items():
        bags.setdefault(url.rpartition("/")[0], []).append(info)
    for url, info in files.items():
        says = _match(names, url)
        if says is None or not _is_recording(url):
            continue
        folder = url.rpartition("/")[0]
        bag = url.lower().endswith(BAG_ENDINGS) and folder in folders
        infos = bags[folder] if bag else [info]
        yield Found(folder if bag else url, sum(int(i.get("size") or 0) for i in infos), _version(infos), **says)


def _match(names: Any, url: str) -> dict[str, str] | None:
    """Return what a pattern says of an address that it, or a folder above it, matches; None if none does."""
    while "://" in url:
        if says := names.fullmatch(url):
            return dict(says.groupdict())
        above = url.rpartition("/")[0]
        url = above if above != url else ""
    return None


def _version(infos: Sequence[Mapping[str, Any]]) -> str:
    """Return what tells that a file, or one of a folder, was changed."""
    told_of = [next((str(info[key]) for key in CHANGED if info.get(key)), "") for info in infos]
    return told_of[0] if len(told_of) == 1 else hashlib.sha256("\0".join(sorted(told_of)).encode()).hexdigest()[:16]
