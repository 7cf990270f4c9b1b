"""Messages of sample streams, read from the bytes in which they travel: see `joint_id_core.formats.cdr`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message

from joint_id_core.data.instants import NANO
from joint_id_core.data.recording import Array
from joint_id_core.data.signals import LARGEST
from joint_id_core.errors import JointIdError
from joint_id_core.formats.cdr import Layout
from joint_id_core.formats.topics import Topic
from joint_id_ros.conversions import check_message


class RawMessage(NamedTuple):
    """One message of a topic.

    Attributes:
        stamp_ns: stamp in ns.
        name: joint names.
        channels: values by channel, each of shape (joints,); a channel that is not measured is left out.
        measured: field of this name in JointSamples, 0 for other types.
        error: why the message cannot be used; None for a good one.
    """

    stamp_ns: int
    name: tuple[str, ...]
    channels: Mapping[str, Array]
    measured: int = 0
    error: JointIdError | None = None


class Reader:
    """Reads the messages of one topic. Messages with the same joints and arrays are read at once."""

    def __init__(self, topic: Topic, kind: Any) -> None:
        """Build a reader of messages of class `kind`."""
        self._topic, self._kind = topic, kind
        self._fields = kind.get_fields_and_field_types()
        self._layout: Layout | None = None

    def read(self, messages: Iterable[bytes]) -> list[RawMessage]:
        """Read messages in their order."""
        found: list[RawMessage] = []
        for layout, some in groupby(messages, key=self._layout_of):
            found += self._read(layout, list(some)) if isinstance(layout, Layout) else [_unusable(layout)]
        return found

    def _layout_of(self, data: bytes) -> Layout | JointIdError:
        """Return the layout of a message, the same object for messages that are alike; an error for a damaged one."""
        if self._layout is None or not self._layout.fits(data):
            try:
                self._layout = Layout.of(self._fields, data)
            except JointIdError as error:
                return JointIdError(f"{self._topic.name}: {error}")
        return self._layout

    def _read(self, layout: Layout, messages: Sequence[bytes]) -> Iterator[RawMessage]:
        numbers, count = layout.read(messages), len(messages)
        stamps_ns = (numbers["sec"].astype(np.int64) * NANO + numbers["nanosec"]).tolist()
        arrays = {
            channel: numbers[field].astype(float)
            for field, channel in self._topic.fields.items()
            if layout.lengths[field]
        }
        measured = numbers["measured"].tolist() if "measured" in self._fields else [0] * count
        suspect = self._suspect(layout, numbers, arrays)
        for k in range(count):
            error = self._complaint(messages[k]) if suspect[k] else None
            channels = {channel: values[k] for channel, values in arrays.items()}
            yield RawMessage(stamps_ns[k], layout.names, channels, measured[k], error)

    def _suspect(self, layout: Layout, numbers: NDArray[Any], arrays: Mapping[str, Array]) -> NDArray[np.bool_]:
        """Return which messages may be wrong: all of those that `check_message` rejects, and hardly any other."""
        names, lengths = layout.names, {len(values[0]) for values in arrays.values()}
        if not names or len(set(names)) < len(names) or lengths != {len(names)}:
            return np.ones(len(numbers), dtype=bool)
        suspect: NDArray[np.bool_] = (numbers["sec"] < 0) | (numbers["nanosec"] >= NANO)
        for values in arrays.values():
            if (large := np.abs(values) > LARGEST).any():  # false for NaN
                suspect = suspect | large.any(axis=1)
        return suspect

    def _complaint(self, data: bytes) -> JointIdError | None:
        """Return what is wrong with a message."""
        try:
            check_message(self._topic, deserialize_message(data, self._kind))
        except JointIdError as error:
            return error
        return None


def _unusable(error: JointIdError) -> RawMessage:
    return RawMessage(0, (), {}, error=error)


def layout_of(message: Any) -> Layout:
    """Return the layout of a message object, to write messages that differ from it in stamp and numbers only."""
    fields, data = message.get_fields_and_field_types(), serialize_message(message)
    return Layout.of(fields, data[: Layout.of(fields, data).end])  # rclpy leaves unused bytes behind the last field
