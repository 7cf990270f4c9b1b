"""Write self-contained rosbag2 bags of version 9, the version of ROS 2 Jazzy."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats.definitions import typestore
from joint_id_core.formats.topics import JOINT_STATE, MEASURED_BITS, RAW, SAMPLES, SIGNAL_FIELDS, SIGNALS, Topic

_PLUGINS = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
# Arrays of the messages that no channel of every topic fills.
FILLED_BY_OTHERS = {
    JOINT_STATE: ("effort",),
    SIGNALS.type: SIGNAL_FIELDS,
}
_MAX_STAMP = 2**31  # s, header.stamp.sec is an int32

Row = tuple[str, Recording, int]


def write_bag(path: str | Path, recordings: Mapping[str, Recording], storage: str = "mcap") -> None:
    """Write the recordings of one robot, by joint name, into a new bag directory.

    They go to the raw topics (`link_states`, `motor_states`, ...) if those have a field for every channel, else
    (accelerations, derived channels) to `joint_samples`. Stamps are rounded to 1 ns; values read back exactly.

    Raises:
        JointIdError: the path exists, unknown storage, nothing to write, a channel without a message field, times that
            do not fit a stamp; it cannot be written, and then nothing of it stays.
    """
    path = Path(path)
    if storage not in _PLUGINS:
        raise JointIdError(f"storage {storage!r}: choose one of {', '.join(_PLUGINS)}")
    if path.exists():
        raise JointIdError(f"{path} exists already: remove it or choose another name")
    raw = {name for topic in (*RAW, SIGNALS) for name in topic.fields.values()}
    fits = all(set(r.channels) <= raw and not r.derived for r in recordings.values())
    _check(path, recordings, raw if fits else MEASURED_BITS)
    used = {name for r in recordings.values() for name in r.channels}
    topics = [t for t in (*RAW, SIGNALS) if used & set(t.fields.values())] if fits else [SAMPLES]
    rows = _rows(path, recordings)
    try:
        _write(path, rows, topics, storage)
    except (OSError, sqlite3.Error) as error:
        shutil.rmtree(path, ignore_errors=True)  # a full disk needs its room, and half a bag misleads
        why = getattr(error, "strerror", None) or error
        raise JointIdError(f"{path}: the bag cannot be written: {why}: check folder, permissions and space") from None


def _write(path: Path, rows: Mapping[int, list[Row]], topics: Sequence[Topic], storage: str) -> None:
    """Write the samples of topics into a new bag."""
    store = typestore()
    with Writer(path, version=9, storage_plugin=_PLUGINS[storage]) as writer:
        connections = {t.name: writer.add_connection(f"/{t.name}", t.type, typestore=store) for t in topics}
        for stamp in sorted(rows):
            for topic in topics:
                for message in _messages(topic, stamp, rows[stamp]):
                    data = store.serialize_cdr(message, topic.type)
                    writer.write(connections[topic.name], stamp, data)


def _check(path: Path, recordings: Mapping[str, Recording], carried: Collection[str]) -> None:
    """Check that messages, which carry some channels, can hold the recordings, before anything is created."""
    if not any(len(r) and r.channels for r in recordings.values()):
        raise JointIdError(f"{path}: no sample to write: give at least one recording with a channel")
    for joint, recording in recordings.items():
        extra = [name for name in recording.channels if name not in carried]
        if extra:
            raise JointIdError(
                f"{path}: no message carries {extra[0]} (joint {joint}): leave it out or write a CSV file"
            )
        if len(recording):
            first, last = recording.origin + recording.time[0], recording.origin + recording.time[-1]
            if not 0 <= first <= last < _MAX_STAMP:
                raise JointIdError(
                    f"{path}: joint {joint} runs from {first:.9g} to {last:.9g} s, a stamp holds 0 to {_MAX_STAMP} s: "
                    "shift the time"
                )


def _stamps(path: Path, joint: str, recording: Recording) -> NDArray[np.int64]:
    """Return the times in integer ns; whole seconds are converted separately, so that large times keep their digits."""
    whole = np.floor(recording.time)
    seconds = recording.origin + whole.astype(np.int64)
    stamps = seconds * 10**9 + np.rint((recording.time - whole) * 1e9).astype(np.int64)
    if (np.diff(stamps) <= 0).any():
        k = int(np.flatnonzero(np.diff(stamps) <= 0)[0])
        raise JointIdError(f"{path}: joint {joint}, sample {k + 1} comes within 1 ns of the one before: thin it out")
    return stamps


def _rows(path: Path, recordings: Mapping[str, Recording]) -> dict[int, list[Row]]:
    """Return, by stamp in ns, the samples (joint, recording, index) with this stamp."""
    rows: dict[int, list[Row]] = {}
    for joint, recording in recordings.items():
        for k, stamp in enumerate(_stamps(path, joint, recording).tolist()):
            rows.setdefault(stamp, []).append((joint, recording, k))
    return rows


def _messages(topic: Topic, stamp: int, rows: list[Row]) -> Iterator[Any]:
    """Yield the messages of one topic at one stamp.

    That is one, or for `joint_samples` one per set of measured channels, with a load or without.
    """
    groups: dict[tuple[int, bool], list[Row]] = {}
    for row in rows:
        if topic is SAMPLES:
            groups.setdefault((_mask(row[1]), "external_torque" in row[1]), []).append(row)
        elif any(name in row[1] for name in topic.fields.values()):
            groups.setdefault((0, False), []).append(row)
    types = typestore().types
    for (mask, _), group in groups.items():
        arrays: dict[str, Any] = {}
        for field, name in topic.fields.items():
            present = any(name in r for _, r, _ in group)
            arrays[field] = np.array([r[name][k] if name in r else np.nan for _, r, k in group] if present else [])
        if topic is SAMPLES:
            arrays["measured"] = mask
        for field in FILLED_BY_OTHERS.get(topic.type, ()):
            arrays.setdefault(field, np.array([]))
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
        yield types[topic.type](header=header, name=[joint for joint, _, _ in group], **arrays)


def _mask(recording: Recording) -> int:
    return sum(bit for name, bit in MEASURED_BITS.items() if name in recording and name not in recording.derived)
