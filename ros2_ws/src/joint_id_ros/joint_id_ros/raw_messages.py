"""Messages of sample streams, read from the bytes in which they travel: see `joint_id_core.formats.cdr`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, repeat
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


@dataclass(frozen=True, eq=False)
class Table:
    """Values of messages with the same joints and arrays.

    Attributes:
        name: joint names.
        channels: values by channel, each of shape (messages, joints); a channel that is not measured is left out.
    """

    name: tuple[str, ...]
    channels: Mapping[str, Array]


class RawMessage(NamedTuple):
    """One message of a topic.

    Attributes:
        stamp_ns: stamp in ns.
        table: values of this message and of those that were read with it.
        row: number of this message in the table.
        measured: field of this name in JointSamples, 0 for other types.
        error: why the message cannot be used; None for a good one.
    """

    stamp_ns: int
    table: Table
    row: int
    measured: int = 0
    error: JointIdError | None = None

    @property
    def name(self) -> tuple[str, ...]:
        """Joint names."""
        return self.table.name

    @property
    def channels(self) -> dict[str, Array]:
        """Values by channel, each of shape (joints,)."""
        return {channel: values[self.row] for channel, values in self.table.channels.items()}


class _Form:
    """Messages of a topic with one layout, and how their values are read at once.

    All values are taken from one array of numbers, which begins with the first value and ends with the last. This
    takes a fifth of the time of one array a channel.

    Attributes:
        layout: the layout.
        odd: whether joints and lengths are such that no message of this layout can be used.
    """

    def __init__(self, topic: Topic, layout: Layout) -> None:
        self.layout = layout
        names, fields = layout.names, [field for field in topic.fields if layout.lengths[field]]
        self.odd = not names or len(set(names)) < len(names) or {layout.lengths[f] for f in fields} != {len(names)}
        places = [range(at := layout.offset(f), at + 8 * layout.lengths[f], 8) for f in fields]
        ends = np.cumsum([len(place) for place in places]).tolist()
        self._channels = {topic.fields[f]: slice(e - len(p), e) for f, p, e in zip(fields, places, ends, strict=True)}
        begin, end = min((p[0] for p in places), default=0), max((p[-1] + 8 for p in places), default=0)
        number = layout.dtype[fields[0]].base if fields else np.dtype(float)
        span: Any = {"names": ["all"], "formats": [(number, ((end - begin) // 8,))], "offsets": [begin]}
        self._span = np.dtype(span | {"itemsize": len(layout.template)})
        self._columns = np.array([(at - begin) // 8 for place in places for at in place], dtype=np.intp)

    def values(self, numbers: NDArray[Any]) -> Array:
        """Return the values of messages that the layout has read, shape (messages, values)."""
        return numbers.view(self._span)["all"][:, self._columns].astype(float, copy=False)

    def table(self, values: Array) -> Table:
        """Return the values by channel."""
        return Table(self.layout.names, {channel: values[:, part] for channel, part in self._channels.items()})


class Reader:
    """Reads the messages of one topic. Messages with the same joints and arrays are read at once."""

    def __init__(self, topic: Topic, kind: Any) -> None:
        """Build a reader of messages of class `kind`."""
        self._topic, self._kind = topic, kind
        self._fields = kind.get_fields_and_field_types()
        self._form: _Form | None = None

    def read(self, messages: Iterable[bytes]) -> list[RawMessage]:
        """Read messages in their order."""
        found: list[RawMessage] = []
        for form, some in groupby(messages, key=self._form_of):
            found += self._read(form, list(some)) if isinstance(form, _Form) else [_unusable(form)]
        return found

    def _form_of(self, data: bytes) -> _Form | JointIdError:
        """Return the form of a message, the same object for messages that are alike; an error for a damaged one."""
        if self._form is None or not self._form.layout.fits(data):
            try:
                self._form = _Form(self._topic, Layout.of(self._fields, data))
            except JointIdError as error:
                return JointIdError(f"{self._topic.name}: {error}")
        return self._form

    def _read(self, form: _Form, messages: Sequence[bytes]) -> list[RawMessage]:
        numbers, count = form.layout.read(messages), len(messages)
        sec, nanosec, values = numbers["sec"].tolist(), numbers["nanosec"].tolist(), form.values(numbers)
        stamps_ns = [s * NANO + n for s, n in zip(sec, nanosec, strict=True)]
        measured = numbers["measured"].tolist() if "measured" in self._fields else [0] * count
        found = list(map(RawMessage, stamps_ns, repeat(form.table(values)), range(count), measured))
        # These contain all messages that `check_message` rejects, and hardly any other.
        if form.odd or min(sec) < 0 or max(nanosec) >= NANO or (np.abs(values) > LARGEST).any():  # false for NaN
            return [m._replace(error=self._complaint(data)) for m, data in zip(found, messages, strict=True)]
        return found

    def _complaint(self, data: bytes) -> JointIdError | None:
        """Return what is wrong with a message."""
        try:
            check_message(self._topic, deserialize_message(data, self._kind))
        except JointIdError as error:
            return error
        return None


def _unusable(error: JointIdError) -> RawMessage:
    return RawMessage(0, Table((), {}), 0, error=error)


def layout_of(message: Any) -> Layout:
    """Return the layout of a message object, to write messages that differ from it in stamp and numbers only."""
    fields, data = message.get_fields_and_field_types(), serialize_message(message)
    return Layout.of(fields, data[: Layout.of(fields, data).end])  # rclpy leaves unused bytes behind the last field
