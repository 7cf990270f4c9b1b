"""Read rosbag2 bags: directories and bare files, mcap and sqlite3.

Topics are recognised by the last part of their name (`topics.py`), so a namespace per robot works. The raw topics are
merged on the union of their stamps, NaN where a topic has no sample. `joint_samples` is read only if there is no raw
topic. A mapping (`bag_mapping.py`) can name other topics and fields; a single topic of joint states, as of
`joint_state_broadcaster`, needs none. The time of a sample is its `header.stamp`, never
the time at which it was recorded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats.bag_mapping import STATES, Source, example, of_states, only_states, plan, states
from joint_id_core.formats.definitions import typestore
from joint_id_core.formats.opened_bag import Bag, opened
from joint_id_core.formats.remote import Place
from joint_id_core.formats.topics import MEASURED_BITS, RAW, SAMPLES, SIGNALS, Topic

Flags = NDArray[np.bool_]
NANO = 10**9
EVERY = "\0"  # stands for all joints; no joint has this name
DAY = 86400  # s; smaller stamps come from a simulation or a test that starts near zero, and are kept as they are


def read(path: Place, joint: str | None, mapping: Mapping[str, str]) -> Recording:
    """Read one joint; `joint` may be None if the bag holds only one. Channels without any value are left out.

    Raises:
        JointIdError: damaged bag, no known topic, wrong message type, invalid mapping, missing joint, stamps that are
            zero, repeat or go backwards.
    """
    seen: dict[str, None] = {}
    with opened(path) as reader:
        tables = [_read_topic(path, reader, source, joint, seen) for source in _sources(path, reader, mapping)]
    names = _named(path, seen)
    if joint is None and len(names) > 1:
        raise JointIdError(f"{path} holds the joints {', '.join(names)}: choose one of them (--joint {names[0]})")
    if joint not in (None, *names):
        raise JointIdError(f"{path} has no joint {joint!r}: it has {', '.join(names)}")
    joint = names[0] if joint is None else joint
    return _joined(path, joint, [table[joint] for table in tables if joint in table])


def read_joints(path: Place, mapping: Mapping[str, str]) -> tuple[str, dict[str, Recording | JointIdError]]:
    """Read all joints in one pass; return the namespace of the topics, and by joint a recording or what is wrong.

    Raises:
        JointIdError: as `read`, what concerns all joints.
    """
    seen: dict[str, None] = {}
    with opened(path) as reader:
        sources = _sources(path, reader, mapping)
        tables = [_read_topic(path, reader, source, EVERY, seen) for source in sources]
    spaces = {source.connection.topic.rpartition("/")[0].strip("/") for source in sources}
    found: dict[str, Recording | JointIdError] = {}
    for joint in _named(path, seen):
        try:
            found[joint] = _joined(path, joint, [table[joint] for table in tables if joint in table])
        except JointIdError as error:
            found[joint] = error
    return spaces.pop() if len(spaces) == 1 else "", found


def _joined(path: Place, joint: str, filled: list[_Table]) -> Recording:
    """Return the recording of one joint from the topics that have samples of it."""
    first = min(table.stamps[0] for table in filled) // NANO
    parts = [table.recording(joint, first if first > DAY else 0) for table in filled]
    merged = _merge(parts, path, joint)
    if not merged.channels:
        raise JointIdError(f"{path}: joint {joint} has no value on any topic: record it again")
    return merged


@dataclass(frozen=True)
class _Table:
    """The samples of one joint on one topic: stamps in ns, channels, names of derived channels, source."""

    stamps: list[int]
    channels: dict[str, Array]
    derived: frozenset[str]
    where: str

    def recording(self, joint: str, origin: int) -> Recording:
        """Return the samples with times since `origin` (whole seconds), subtracted as integers to keep every digit."""
        time = np.array([(stamp - origin * NANO) / NANO for stamp in self.stamps])
        return Recording(time, self.channels, self.derived, self.where, joint, origin)


def joints(path: Place, mapping: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the joints, in order of appearance.

    Raises:
        JointIdError: damaged bag, no known topic, wrong message type, invalid mapping, no joint name.
    """
    names: dict[str, None] = {}
    with opened(path) as reader:
        for source in _sources(path, reader, mapping):
            for message in _messages(reader, source.connection):
                names.update(dict.fromkeys(message.name))
    return _named(path, names)


def _named(path: Place, seen: dict[str, None]) -> tuple[str, ...]:
    """Return the joint names; raise JointIdError if there is none."""
    if not seen:
        raise JointIdError(f"{path}: the messages name no joint: fill the field 'name' when publishing")
    return tuple(seen)


def taken(path: Place, mapping: Mapping[str, str]) -> list[str]:
    """Return in words what is taken for what where that is not certain.

    Raises:
        JointIdError: as `joints`.
    """
    with opened(path) as reader:
        return [of_states(s.topic) for s in _sources(path, reader, mapping) if s.topic.fields is STATES]


def topics(path: Place) -> tuple[str, ...]:
    """Return the topics with their types, "topic (type)".

    Raises:
        JointIdError: damaged bag, or not a bag.
    """
    with opened(path) as reader:
        return _topics(reader)


def _topics(reader: Bag) -> tuple[str, ...]:
    return tuple(sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections}))


def _sources(path: Place, reader: Bag, mapping: Mapping[str, str]) -> list[Source]:
    """Return the topics to read."""
    if mapping:
        return plan(path, reader.connections, mapping)
    return [Source(topic, connection, {}) for topic, connection in _known(path, reader)]


def _known(path: Place, reader: Bag) -> list[tuple[Topic, Connection]]:
    """Return the topics with joint_id's own names, all in one namespace: the raw topics, or else `joint_samples`."""
    by_name = {topic.name: topic for topic in (*RAW, SAMPLES)}
    matched = [(by_name[last], c) for c in reader.connections if (last := c.topic.rsplit("/", 1)[-1]) in by_name]
    if not matched and (found := only_states(reader.connections)) is not None:
        named = next((message.name for message in _messages(reader, found)), ())
        if (topic := states(found, named)) is not None:
            return [(topic, found)]
    if not matched:
        raise JointIdError(
            f"{path}: no known topic: it has {', '.join(_topics(reader))}; understood are {', '.join(by_name)}"
            f"{example(reader.connections)}"
        )
    for topic, c in matched:
        if c.msgtype != topic.type:
            raise JointIdError(f"{path}: topic {c.topic} is of type {c.msgtype}, not {topic.type}: remap or convert it")
    filled = [(topic, c) for topic, c in matched if c.msgcount]
    if not filled:
        raise JointIdError(f"{path}: no message on {', '.join(c.topic for _, c in matched)}: record it again")
    chosen = [(topic, c) for topic, c in filled if topic is not SAMPLES] or filled
    if chosen[0][0] is not SAMPLES:
        chosen += [(SIGNALS, c) for c in reader.connections if _are_signals(c, _spaces(chosen))]
    if len({c.topic for _, c in chosen}) > len({topic.name for topic, _ in chosen}) or len(_spaces(chosen)) > 1:
        raise JointIdError(
            f"{path}: several namespaces hold known topics ({', '.join(_spaces(chosen))}): keep one robot a bag "
            "(`ros2 bag convert`)"
        )
    return chosen


def _spaces(chosen: list[tuple[Topic, Connection]]) -> list[str]:
    return sorted({c.topic.rpartition("/")[0] or "/" for _, c in chosen})


def _are_signals(connection: Connection, spaces: Sequence[str]) -> bool:
    """Return whether a topic holds other signals of the robot whose raw topics are in the namespaces."""
    space, _, name = connection.topic.rpartition("/")
    right = (name, connection.msgtype) == (SIGNALS.name, SIGNALS.type)
    return right and bool(connection.msgcount) and (space or "/") in spaces


def _store(connection: Connection) -> Typestore:
    """Return joint_id's own message definitions, or those in the bag if they differ."""
    store, kind = typestore(), connection.msgdef.format
    if kind is MessageDefinitionFormat.NONE or connection.digest == store.hash_rihs01(connection.msgtype):
        return store  # bare files may have no digest
    own = get_typestore(Stores.ROS2_JAZZY)
    text = connection.msgdef.data
    is_msg = kind is MessageDefinitionFormat.MSG
    own.register(get_types_from_msg(text, connection.msgtype) if is_msg else get_types_from_idl(text))
    return own


def _messages(reader: Bag, connection: Connection) -> Iterator[Any]:
    """Yield the decoded messages of one topic.

    Raises:
        JointIdError: fewer messages than the bag's index promises.
    """
    store, count = _store(connection), 0
    for _, _, data in reader.messages([connection]):
        yield store.deserialize_cdr(data, connection.msgtype)
        count += 1
    if count < connection.msgcount:
        raise JointIdError(
            f"{reader.path}: truncated, {connection.topic} has {count} of {connection.msgcount} messages: "
            "record it again"
        )


@dataclass
class _Columns:
    """The samples of one joint on a topic while they are read; `never`: channels not measured in some message."""

    stamps: list[int]
    values: dict[str, list[float]]
    never: Flags


def _read_topic(
    path: Place, reader: Bag, source: Source, joint: str | None, seen: dict[str, None]
) -> dict[str, _Table]:
    """Read a topic: the samples of one joint (None: the first one), or of `EVERY` joint; adds the names to `seen`."""
    topic, connection, factors = source
    where = f"{path}, topic {connection.topic}"
    read: dict[str, _Columns] = {}
    channels = tuple(topic.fields.values())
    for number, message in enumerate(_messages(reader, connection)):
        seen.update(dict.fromkeys(message.name))
        if joint is None:
            joint = next(iter(seen), None)
        wanted = list(dict.fromkeys(message.name)) if joint == EVERY else [str(joint)]
        length, stamp = len(message.name), message.header.stamp
        for name in wanted:
            if name not in message.name:
                continue
            index = message.name.index(name)
            if name not in read:
                read[name] = _Columns([], {c: [] for c in channels}, np.zeros(len(channels), dtype=bool))
            columns = read[name]
            columns.stamps.append(stamp.sec * NANO + stamp.nanosec)
            for k, (field, channel) in enumerate(topic.fields.items()):
                values = getattr(message, field, ())  # an older definition may lack the field
                if len(values) not in (0, length):
                    raise JointIdError(
                        f"{where}: message {number} has {len(values)} values of {field} for {length} joints: "
                        "mend the publisher"
                    )
                value = float(values[index]) if len(values) else np.nan
                columns.values[channel].append(value)
                # a load that is not known is no zero
                told = value == value or (channel == "external_torque" and len(values))
                if topic is SAMPLES and not message.measured & MEASURED_BITS[channel] and told:
                    columns.never[k] = True
    if any(len(c.stamps) > 1 and not any(c.stamps) for c in read.values()):
        raise JointIdError(f"{where}: every header.stamp is zero: stamp the messages when publishing")
    tables = {}
    for name, columns in read.items():
        scaled = {c: factors.get(c, 1.0) * np.array(column) for c, column in columns.values.items()}
        derived = frozenset(c for c, flag in zip(channels, columns.never, strict=True) if flag)
        tables[name] = _Table(columns.stamps, scaled, derived, where)
    return tables


def _merge(parts: list[Recording], path: Place, joint: str) -> Recording:
    """Merge all topics on the union of their stamps."""
    time = np.unique(np.concatenate([part.time for part in parts]))
    channels: dict[str, Array] = {}
    for part in parts:
        rows = np.searchsorted(time, part.time)
        for name, values in part.channels.items():
            if np.isnan(values).all() and name not in part.derived:
                continue
            channels[name] = np.full(time.shape, np.nan)
            channels[name][rows] = values
    derived = frozenset(name for part in parts for name in part.derived if name in channels)
    return Recording(time, channels, derived, str(path), joint, parts[0].origin)
