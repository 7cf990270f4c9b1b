"""JointSamples between the bytes in which they travel and the core's types."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.data.instants import NANO, seconds
from joint_id_core.data.recording import Recording
from joint_id_core.estimators.shared.computed_load import LOAD
from joint_id_core.formats.cdr import Layout
from joint_id_core.formats.topics import MEASURED_BITS, SAMPLES
from joint_id_msgs.msg import JointSamples
from joint_id_ros.raw_messages import RawMessage, Table, layout_of

CHANNELS = tuple(SAMPLES.fields.values())


class SamplesWriter:
    """Writes messages of aligned samples; those with the same joints and channels have the same layout."""

    def __init__(self) -> None:
        self._form: tuple[object, ...] = ()
        self._layout: Layout | None = None

    def write(self, samples: AlignedSamples) -> list[bytes]:
        """Return the bytes of one message per instant."""
        form = (tuple(samples.joints), tuple(samples.channels), samples.derived)
        if self._layout is None or form != self._form:
            self._form, self._layout = form, layout_of(_first(samples))
        numbers = self._layout.blank(len(samples.instants_ns))
        numbers["sec"], numbers["nanosec"] = zip(*(divmod(ns, NANO) for ns in samples.instants_ns), strict=True)
        for name, values in samples.channels.items():
            numbers[name] = values
        return self._layout.write(numbers)


def _first(samples: AlignedSamples) -> JointSamples:
    """Return the message of the first sample, without its stamp."""
    message = JointSamples(name=list(samples.joints))
    for name, values in samples.channels.items():
        setattr(message, name, values[0].tolist())
    message.measured = sum(MEASURED_BITS[name] for name in samples.channels if name not in samples.derived)
    return message


def to_recordings(messages: Sequence[RawMessage], origin_ns: int, source: str) -> dict[str, Recording]:
    """Return one recording per joint, with time in s since the origin, from messages of JointSamples without error.

    The messages must be in the order of their stamps. A channel is derived if any of the messages says so. A channel
    without any value is left out; a load without any is one that is not known, and no load of zero.
    """
    time = np.array([seconds(message.stamp_ns, origin_ns) for message in messages])
    checked = Recording(time, {}, source=source)  # the values were checked when they were read
    groups = [(table, measured, [m.row for m in some]) for (table, measured), some in groupby(messages, key=_source)]
    derived: dict[str, set[str]] = {joint: set() for table, _, _ in groups for joint in table.name}
    joints = list(derived)
    values = np.full((len(joints), len(CHANNELS), len(messages)), np.nan)
    named = np.zeros((len(joints), len(messages)), dtype=bool)
    begin = 0
    for table, measured, numbers in groups:
        rows, end = _index(numbers), begin + len(numbers)
        places = _index([joints.index(joint) for joint in table.name])
        named[places, begin:end] = True
        for channel, known in table.channels.items():
            values[places, CHANNELS.index(channel), begin:end] = known[rows].T
        unmeasured = {channel for channel in table.channels if not measured & MEASURED_BITS[channel]}
        for joint in table.name:
            derived[joint] |= unmeasured
        begin = end
    recordings = {}
    missing, everywhere = np.isnan(values), named.all()
    kept = LOAD if any(LOAD in table.channels for table, _, _ in groups) else ""
    for joint, own, gone, here in zip(joints, values, missing.all(axis=2).tolist(), named, strict=True):
        found = {name: row for name, row, none in zip(CHANNELS, own, gone, strict=True) if not none or name == kept}
        if not everywhere:
            found = {channel: row[here] for channel, row in found.items()}
        marks = frozenset(derived[joint].intersection(found))
        recordings[joint] = checked.trusted(time if everywhere else time[here], found, marks, joint)
    return recordings


def _source(message: RawMessage) -> tuple[Table, int]:
    return message.table, message.measured


def _index(numbers: list[int]) -> slice | list[int]:
    """Return an index of these rows, if possible one that copies nothing."""
    first = numbers[0]
    return slice(first, first + len(numbers)) if numbers == list(range(first, first + len(numbers))) else numbers
