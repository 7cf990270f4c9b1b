"""Read and write many messages of one type at once, in the bytes in which they travel (CDR, OMG DDS-XTypes, XCDR1).

Converting a message with names and arrays to Python objects costs more than what joint_id's nodes do with its numbers.
But the messages of a stream differ only in the stamp and the numbers: as long as names and lengths stay the same, every
number stays at its place. So the places are found once, and NumPy reads or writes whole batches there.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from joint_id_core.errors import JointIdError

HEADER = 4  # bytes before the first field; they say the order of bytes, and alignment counts from their end
ORDERS = {b"\0\0": ">", b"\0\1": "<"}
SCALARS = {"double": "f8", "float": "f4"} | {
    f"{sign}int{8 * size}": f"{sign[:1] or 'i'}{size}" for size in (1, 2, 4, 8) for sign in ("", "u")
}
SEQUENCES = {f"sequence<{name}>": code for name, code in SCALARS.items()}
_ENDED = (struct.error, IndexError, UnicodeDecodeError)


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the numbers in messages of one type with the same names and lengths.

    Attributes:
        names: content of the field `name`.
        lengths: length of each array field.
        dtype: fields `sec` and `nanosec` of the stamp, and every field with numbers, at their places in a message.
        template: the message from which the layout was learnt.
        end: bytes up to the end of the last field; what follows is padding.
    """

    names: tuple[str, ...]
    lengths: Mapping[str, int]
    dtype: np.dtype[Any]
    template: bytes
    end: int
    _constants: struct.Struct
    _key: tuple[bytes, ...]

    @classmethod
    def of(cls, fields: Mapping[str, str], data: bytes) -> Layout:
        """Find the places in a message.

        Args:
            fields: type of each field in ROS notation, as `get_fields_and_field_types()` of a message class gives
                them. The first is a std_msgs/Header; the others are numbers, sequences of numbers or of strings.
            data: the message.

        Raises:
            JointIdError: the bytes are no such message.
        """
        try:
            return _Walk(fields, data).layout()
        except _ENDED as error:
            raise JointIdError(f"a message of {len(data)} bytes is damaged ({error}): mend the publisher") from None

    def fits(self, data: bytes) -> bool:
        """Return whether a message has this layout."""
        return len(data) == len(self.template) and self._constants.unpack(data) == self._key

    def offset(self, field: str) -> int:
        """Return the place of a field's first number in bytes from the begin of the message."""
        assert self.dtype.fields is not None
        return self.dtype.fields[field][1]

    def read(self, messages: Sequence[bytes]) -> NDArray[Any]:
        """Return the numbers of messages that fit, shape (T,), read-only; array fields have shape (T, length)."""
        return np.frombuffer(b"".join(messages), self.dtype)

    def blank(self, count: int) -> NDArray[Any]:
        """Return the numbers of `count` copies of the template, to be changed and given to `write`."""
        return np.frombuffer(bytearray(self.template * count), self.dtype)

    def write(self, numbers: NDArray[Any]) -> list[bytes]:
        """Return messages with these numbers; inverse of `read` for an array of `blank`."""
        size, data = len(self.template), numbers.tobytes()
        return [data[k : k + size] for k in range(0, len(data), size)]


class _Walk:
    """Walks once through a message, field by field."""

    def __init__(self, fields: Mapping[str, str], data: bytes) -> None:
        self._data, self._at = data, 0
        self._order = ORDERS.get(data[:2], "")
        if not self._order:
            raise struct.error(f"encoding {data[:2].hex()}")
        self._constants, self._from = self._order, 0
        self._fixed(2)
        self._at = HEADER
        self._names: tuple[str, ...] = ()
        self._lengths: dict[str, int] = {}
        self._places: list[tuple[str, Any, int]] = []
        for name, kind in fields.items():
            if kind == "std_msgs/Header":
                self._number("sec", "i4")
                self._number("nanosec", "u4")
                self._string()
            elif kind == "sequence<string>":
                strings = tuple(self._string() for _ in range(self._count()))
                self._names = strings if name == "name" else self._names
            elif kind in SEQUENCES:
                self._lengths[name] = length = self._count()
                self._number(name, SEQUENCES[kind], length)
            else:
                self._number(name, SCALARS[kind])

    def layout(self) -> Layout:
        size, names = len(self._data), [name for name, _, _ in self._places]
        if self._at > size:
            raise struct.error(f"its fields take {self._at} bytes")
        formats, offsets = [kind for _, kind, _ in self._places], [at for _, _, at in self._places]
        dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
        constants = struct.Struct(f"{self._constants}{size - self._from}x")
        return Layout(self._names, self._lengths, dtype, self._data, self._at, constants, constants.unpack(self._data))

    def _align(self, size: int) -> None:
        self._at += -(self._at - HEADER) % size

    def _fixed(self, size: int) -> None:
        """Note bytes that do not change, and step over them."""
        self._constants += f"{self._at - self._from}x{size}s"
        self._at += size
        self._from = self._at

    def _count(self) -> int:
        self._align(4)
        (count,) = struct.unpack_from(f"{self._order}I", self._data, self._at)
        self._fixed(4)
        if count > len(self._data):
            raise struct.error(f"a length of {count}")
        return int(count)

    def _string(self) -> str:
        size, at = self._count(), self._at
        self._fixed(size)
        return self._data[at : at + size].rstrip(b"\0").decode()

    def _number(self, name: str, code: str, length: int | None = None) -> None:
        """Note the place of a number, or of an array, which is aligned only if it has elements."""
        size = int(code[1:])
        if length != 0:
            self._align(size)
        self._places.append((name, self._order + code if length is None else (self._order + code, (length,)), self._at))
        self._at += size * (1 if length is None else length)
