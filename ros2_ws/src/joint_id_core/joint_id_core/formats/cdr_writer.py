"""Write messages of nested types, part by part, in the bytes in which they travel (see `cdr`).

To fill the fields of message objects and to serialize these costs about a microsecond a number. But parts of one type
that follow each other mostly differ in their numbers alone. So the bytes between the numbers are kept for as long as
they stay the same, and one call of `struct` writes all.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from operator import itemgetter
from typing import Any, Protocol

from joint_id_core.formats.cdr import SCALARS

BEGIN = b"\0\1\0\0"  # of a message whose numbers begin with their lowest byte
LETTERS = {"f8": "d", "f4": "f", "i1": "b", "i2": "h", "i4": "i", "i8": "q", "u1": "B", "u2": "H", "u4": "I", "u8": "Q"}

Fields = Mapping[str, str]  # type of each field in ROS notation, as `get_fields_and_field_types()` gives them


class PartWriter:
    """Writes messages of one type, or parts of messages, that stand at any place."""

    def __init__(self, fields: Fields, fields_of: Callable[[str], Fields]) -> None:
        """Build a writer of a type with these fields; `fields_of` returns the fields of the types that they name."""
        self._type = _Nested(fields, fields_of)
        self._form: _Form | None = None

    def write(self, values: Sequence[Any], offset: int = 0) -> bytes:
        """Return the bytes of a part, without `BEGIN`.

        Args:
            values: one value a field, in their order; for nested messages such a sequence of values, for arrays a
                sequence of elements.
            offset: number of bytes between `BEGIN` and the part, which says how its numbers are aligned.
        """
        flat = [offset % 8]
        self._type.flatten(values, flat)
        if self._form is None or not self._form.fits(flat):
            self._form = _Form(self._type, flat)
        return self._form.write(flat)


class _Type(Protocol):
    """A type of fields or elements; `plain` types are those of numbers and strings, and messages of these alone."""

    plain: bool

    def flatten(self, value: Any, flat: list[Any]) -> None:
        """Append numbers and strings of a value, and the lengths of its arrays."""

    def lay_out(self, form: _Form) -> None:
        """Tell the form what was appended."""


class _Number:
    plain = True

    def __init__(self, name: str) -> None:
        code = SCALARS[name]
        self._letter, self._size = LETTERS[code], int(code[1:])

    def flatten(self, value: Any, flat: list[Any]) -> None:
        flat.append(value)

    def lay_out(self, form: _Form) -> None:
        form.number(self._letter, self._size)


class _String:
    plain = True

    def flatten(self, value: Any, flat: list[Any]) -> None:
        flat.append(value)

    def lay_out(self, form: _Form) -> None:
        form.string()


class _Array:
    plain = False

    def __init__(self, element: _Type) -> None:
        self._element = element

    def flatten(self, value: Any, flat: list[Any]) -> None:
        flat.append(len(value))
        if not self._element.plain:
            for element in value:
                self._element.flatten(element, flat)
        else:
            flat.extend(chain.from_iterable(value) if isinstance(self._element, _Nested) else value)

    def lay_out(self, form: _Form) -> None:
        for _ in range(form.count()):
            self._element.lay_out(form)


class _Nested:
    def __init__(self, fields: Fields, fields_of: Callable[[str], Fields]) -> None:
        self._fields = [_type(name, fields_of) for name in fields.values()]
        self.plain = all(isinstance(field, _Number | _String) for field in self._fields)

    def flatten(self, value: Any, flat: list[Any]) -> None:
        if self.plain:
            flat.extend(value)
            return
        for field, part in zip(self._fields, value, strict=True):
            field.flatten(part, flat)

    def lay_out(self, form: _Form) -> None:
        for field in self._fields:
            field.lay_out(form)


def _type(name: str, fields_of: Callable[[str], Fields]) -> _Type:
    if name.startswith("sequence<"):
        return _Array(_type(name.removeprefix("sequence<").removesuffix(">"), fields_of))
    if name == "string":
        return _String()
    return _Number(name) if name in SCALARS else _Nested(fields_of(name), fields_of)


class _Form:
    """Bytes between the numbers of parts with the same strings, lengths and alignment."""

    def __init__(self, kind: _Nested, flat: list[Any]) -> None:
        """Learn the bytes from the flattened values of a part; the first of them is its offset."""
        self._flat, self._at, self._next = flat, flat[0], 1
        self._format, self._between = "<", bytearray()
        self._constants: list[bytes] = []
        self._order: list[int] = []  # what is written, by its place in flattened values with the constants behind them
        self._fixed = [0]  # places of what must be the same
        self._end_of_constant()
        kind.lay_out(self)
        self._end_of_constant()
        self._length, self._fixed_of, self._ordered = len(flat), itemgetter(*self._fixed), itemgetter(*self._order)
        self._key, self._pack = self._fixed_of(flat), struct.Struct(self._format).pack

    def fits(self, flat: list[Any]) -> bool:
        """Return whether a part has this form."""
        return len(flat) == self._length and bool(self._fixed_of(flat) == self._key)

    def write(self, flat: list[Any]) -> bytes:
        """Return the bytes of a part of this form."""
        return self._pack(*self._ordered(flat + self._constants))

    def number(self, letter: str, size: int) -> None:
        """Take the next value as a number."""
        self._align(size)
        if self._between:
            self._end_of_constant()
        self._format += letter
        self._order.append(self._next)
        self._next += 1
        self._at += size

    def string(self) -> None:
        """Take the next value as a string."""
        data = self._take().encode() + b"\0"
        self._align(4)
        self._add(struct.pack("<I", len(data)) + data)

    def count(self) -> int:
        """Take the next value as the length of an array, and return it."""
        count: int = self._take()
        self._align(4)
        self._add(struct.pack("<I", count))
        return count

    def _take(self) -> Any:
        self._fixed.append(self._next)
        self._next += 1
        return self._flat[self._next - 1]

    def _align(self, size: int) -> None:
        self._add(bytes(-self._at % size))

    def _add(self, data: bytes) -> None:
        self._between += data
        self._at += len(data)

    def _end_of_constant(self) -> None:
        self._format += f"{len(self._between)}s"
        self._order.append(len(self._flat) + len(self._constants))
        self._constants.append(bytes(self._between))
        self._between = bytearray()
