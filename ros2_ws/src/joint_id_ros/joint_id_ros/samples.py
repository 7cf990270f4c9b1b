"""JointSamples between the bytes in which they travel and the core's types."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from joint_id_core.alignment.aligner import AlignedSamples
from joint_id_core.data.instants import NANO, seconds
from joint_id_core.data.recording import Array, Recording
from joint_id_core.formats.cdr import Layout
from joint_id_core.formats.topics import MEASURED_BITS, SAMPLES
from joint_id_msgs.msg import JointSamples
from joint_id_ros.raw_messages import RawMessage, layout_of


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
    without any value is left out.
    """
    times: dict[str, list[Array]] = {}
    columns: dict[str, dict[str, list[Array]]] = {}
    derived: dict[str, set[str]] = {}
    for (joints, names, measured), alike in groupby(messages, key=_form):
        group = list(alike)
        time = np.array([seconds(message.stamp_ns, origin_ns) for message in group])
        known = {name: np.array([message.channels[name] for message in group]).T for name in names}
        missing = np.full(len(group), np.nan)
        unmeasured = {name for name in names if not measured & MEASURED_BITS[name]}
        for k, joint in enumerate(joints):
            times.setdefault(joint, []).append(time)
            column = columns.setdefault(joint, {channel: [] for channel in SAMPLES.fields})
            for channel, parts in column.items():
                parts.append(known[channel][k] if channel in known else missing)
            derived.setdefault(joint, set()).update(unmeasured)
    recordings = {}
    for joint, column in columns.items():
        joined = {channel: np.concatenate(parts) for channel, parts in column.items()}
        found = {channel: values for channel, values in joined.items() if not np.isnan(values).all()}
        marks = frozenset(derived[joint] & set(found))
        recordings[joint] = Recording(np.concatenate(times[joint]), found, marks, source=source, joint=joint)
    return recordings


def _form(message: RawMessage) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    return message.name, tuple(message.channels), message.measured
