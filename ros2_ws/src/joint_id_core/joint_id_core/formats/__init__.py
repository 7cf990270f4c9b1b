"""Read and write recordings: rosbag2 (mcap, sqlite3), CSV and MAT.

`read` picks the format: `.csv` (or `.txt`, `.tsv`, also with `.gz`), `.mat`, or a bag, which is a directory with
`metadata.yaml` or a bare `.mcap` or `.db3` file. Gaps, unequal steps and NaN are kept as they are; nothing is resampled
or filled in. What is read may lie in object storage (`remote.py`): of an mcap file there only the chunks with topics of
joints are read, other files are copied first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType, NoneType
from typing import NamedTuple

from joint_id_core.arguments import require_type
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats import csv_file, mat_file
from joint_id_core.formats.csv_file import write_csv
from joint_id_core.formats.remote import Place, RemotePath, copied, place

KINDS = {".csv": "csv", ".txt": "csv", ".tsv": "csv", ".mat": "mat", ".mcap": "bag", ".db3": "bag"}  # by ending
ADVICE = 'give a dictionary, such as {"torque": "gtau*vir"}'
__all__ = ["contents", "joints", "read", "read_joints", "taken", "unread", "write", "write_bag", "write_csv"]


class Joints(NamedTuple):
    """What a file holds: the namespace of its topics, and by joint the recording or what is wrong with it."""

    namespace: str
    recordings: dict[str, Recording | JointIdError]


def read(path: str | Place, joint: str | None = None, mapping: Mapping[str, str] | None = None) -> Recording:
    """Read the recording of one joint.

    Args:
        path: the file or bag.
        joint: name of the joint; needed when the file holds several. Other files hold one unnamed joint, which then
            gets this name.
        mapping: where `time_s` and channels come from: {channel: expression}. An expression is a product of columns and
            numbers, e.g. {"time_s": "t", "torque": "gtau*vir"}. Columns of CSV and MAT files with a known name need no
            mapping. With a mapping, only the mapped channels of a bag are read, each from one field:
            {"current": "joint_states.effort"}. The time of a bag is always `header.stamp`.

    Raises:
        JointIdError: unreadable or damaged file, wrong types, missing joint, columns that are not understood.
    """
    require_type("mapping", mapping, (Mapping, NoneType), ADVICE)
    for target, expression in (mapping or {}).items():
        require_type(f"mapping of {target}", expression, str, ADVICE)
    require_type("joint", joint, (str, NoneType), "give the name of a joint")
    path = place(path)
    kind = _kind(path)
    if isinstance(path, RemotePath):
        if not _needed_here(path, kind):
            return _bags().read(path, joint, mapping or {})
        with copied(path) as here:
            return replace(read(here, joint, mapping), source=str(path))
    if kind == "csv":
        return csv_file.read(path, joint or "", mapping or {})
    if kind == "mat":
        return mat_file.read(path, joint or "", mapping or {})
    return _bags().read(path, joint, mapping or {})


def read_joints(path: str | Place, mapping: Mapping[str, str] | None = None, joint: str = "") -> Joints:
    """Read the recordings of all joints of a file, a bag in one pass.

    Args:
        path, mapping: as for `read`.
        joint: name of the joint of a file that holds one without a name.

    Raises:
        JointIdError: the file, or what all of its joints share, cannot be read.
    """
    path = place(path)
    kind = _kind(path)
    if isinstance(path, RemotePath) and _needed_here(path, kind):
        with copied(path) as here:
            space, found = read_joints(here, mapping, joint)
        own = str(path)
        for name, one in found.items():
            if isinstance(one, JointIdError):
                found[name] = JointIdError(str(one).replace(str(here), own))
            else:
                found[name] = replace(one, source=own)
        return Joints(space, found)
    if kind == "bag":
        return Joints(*_bags().read_joints(path, mapping or {}))
    names = joints(path, mapping)
    if not names:
        return Joints("", {joint: read(path, joint, mapping)})
    recordings: dict[str, Recording | JointIdError] = {}
    for name in names:
        try:
            recordings[name] = read(path, name, mapping)
        except JointIdError as error:
            recordings[name] = error
    return Joints("", recordings)


def joints(path: str | Place, mapping: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """Return the names of the joints in a bag, or in a table with columns of several, in order of appearance.

    () for other files, which hold one joint.

    `mapping` as for `read`.

    Raises:
        JointIdError: unreadable or damaged file; of a bag, no known topic, or a mapping that is not understood.
    """
    path = place(path)
    kind = _kind(path)
    if isinstance(path, RemotePath):
        if not _needed_here(path, kind):
            return tuple(_bags().joints(path, mapping or {}))
        with copied(path) as here:
            return joints(here, mapping)
    if kind == "bag":
        return tuple(_bags().joints(path, mapping or {}))
    return (csv_file if kind == "csv" else mat_file).joints(path, mapping or {})


def contents(path: str | Path) -> tuple[str, ...]:
    """Return the contents of a file: columns of a CSV, variables of a MAT file, "topic (type)" of a bag.

    Raises:
        JointIdError: unreadable or damaged file.
    """
    path = Path(path)
    kind = _kind(path)
    if kind == "csv":
        return csv_file.columns(path)
    return mat_file.variables(path) if kind == "mat" else _bags().topics(path)


def taken(path: str | Path, joint: str | None = None, mapping: Mapping[str, str] | None = None) -> list[str]:
    """Return in words which columns or fields are read as which channels, where their names do not say it.

    Without a `joint`, those of every joint of a table that holds several.

    Raises:
        JointIdError: unreadable file, columns that are not understood.
    """
    path = Path(path)
    kind = _kind(path)
    if kind == "bag":
        return list(_bags().taken(path, mapping or {}))
    return (csv_file if kind == "csv" else mat_file).taken(path, joint or "", mapping or {})


def unread(path: str | Path, mapping: Mapping[str, str] | None = None) -> list[str]:
    """Return the columns of a table that no joint reads; [] for a bag.

    Raises:
        JointIdError: unreadable file, columns that are not understood.
    """
    path = Path(path)
    kind = _kind(path)
    if kind == "bag":
        return []
    return (csv_file if kind == "csv" else mat_file).unread(path, mapping or {})


def write(path: str | Path, recording: Recording) -> None:
    """Write a recording: as CSV if the path ends in .csv, else as a bag directory.

    Raises:
        JointIdError: the path exists or cannot be written; a bag without rosbags installed; what is no recording.
    """
    require_type("path", path, (str, Path), "give the name of a file")
    require_type("recording", recording, Recording, 'make it with read("motion.csv")')
    if Path(path).suffix.lower() == ".csv":
        write_csv(path, recording)
    else:
        write_bag(path, {recording.joint or "joint": recording})


def write_bag(path: str | Path, recordings: Mapping[str, Recording], storage: str = "mcap") -> None:
    """Write the recordings of several joints, by joint name, into one bag; see `bag_writer.write_bag`.

    Raises:
        JointIdError: the path exists, a recording cannot be written, or rosbags is not installed.
    """
    _bags()
    from joint_id_core.formats import bag_writer

    bag_writer.write_bag(path, recordings, storage)


def _bags() -> ModuleType:
    """Import the bag reader. Only bags need rosbags and mcap: nodes and CSV files work without them."""
    try:
        from joint_id_core.formats import bag_reader
    except ModuleNotFoundError as error:
        raise JointIdError(f"bags need the packages rosbags and mcap ({error}): pip install rosbags mcap") from None
    return bag_reader


def _needed_here(path: RemotePath, kind: str) -> bool:
    """Return whether a reader needs a file or folder on this computer: all but mcap files are read as a whole."""
    return kind != "bag" or any(one.suffix == ".db3" for one in (path.iterdir() if path.is_dir() else (path,)))


def _kind(path: Place) -> str:
    """Return the format of `path`, after a check that there is something to read."""
    if not path.exists():
        if isinstance(path, Path) and path.is_symlink():
            raise JointIdError(f"{path}: a link that leads to no file: check where it leads")
        raise JointIdError(f"{path}: no such file or directory: check the path")
    if path.is_dir():
        return "bag"
    if isinstance(path, Path) and not path.is_file():
        raise JointIdError(f"{path}: a pipe or a device, which can be read only once: write it to a file first")
    name = path.name.lower().removesuffix(".gz")
    kind = next((kind for ending, kind in KINDS.items() if name.endswith(ending)), None)
    kind = None if kind != "csv" and path.suffix.lower() == ".gz" else kind
    if path.name == "metadata.yaml":
        raise JointIdError(f"{path}: this is the index of a bag: give its directory, {str(path).rpartition('/')[0]}")
    if kind is None:
        raise JointIdError(
            f"{path}: not a known format: give a .csv, .txt, .tsv, .mat, .mcap or .db3 file or a bag directory"
        )
    if path.stat().st_size == 0:
        raise JointIdError(f"{path}: the file is empty: record it again")
    return kind
