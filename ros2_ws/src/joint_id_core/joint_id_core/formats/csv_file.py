"""CSV files: a header, then one line per sample.

Columns are `time_s` and any of `joint_id_core.data.signals.CHANNELS`, in SI units. A signal without a column was not
measured; an empty cell or `nan` is a missing value. Other columns are ignored unless a mapping names them. The
delimiter (comma, semicolon, tab or spaces) is found from the header.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats.mapping import TARGETS, TIME, plan


def read(path: Path, joint: str, mapping: Mapping[str, str]) -> Recording:
    """Read a CSV file; `mapping` as in `joint_id_core.formats.read`.

    Raises:
        JointIdError: no usable header, a line of the wrong length, a cell that is not a number. The message names file,
            line and column.
    """
    header, rows, numbers = _table(path)
    products = plan(path, header, mapping)
    columns: dict[str, Array] = {}
    for name in {name for product in products.values() for name in product.names}:
        if header.count(name) > 1:
            raise JointIdError(f"{path}: {header.count(name)} columns are called {name!r}: rename all but one")
        columns[name] = _column(path, name, header.index(name), rows, numbers)
    values: dict[str, Array] = {}
    for target, product in products.items():
        values[target] = np.prod([columns[name] for name in product.names], axis=0)
        if product.factor != 1.0:
            values[target] = product.factor * values[target]
    return Recording(values.pop(TIME), values, source=str(path), joint=joint)


def columns(path: Path) -> tuple[str, ...]:
    """Return the column names in the header.

    Raises:
        JointIdError: no header, or not a text file.
    """
    return tuple(_table(path)[0])


def write_csv(path: str | Path, recording: Recording) -> None:
    """Write time and the measured channels; every number reads back exactly, NaN becomes an empty cell.

    Derived channels are left out: a CSV file cannot mark them, so they would read back as measurements.

    Raises:
        JointIdError: the file exists, or the recording has no measured channel.
    """
    path = Path(path)
    if path.exists():
        raise JointIdError(f"{path} exists already: remove it or choose another name")
    names = [name for name in recording.channels if name not in recording.derived]
    if not names:
        raise JointIdError(f"{recording.source} has no measured channel: nothing to write to {path}")
    table = zip(*(recording[name].tolist() for name in names), strict=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([TIME, *names])
        for time, row in zip(recording.time.tolist(), table, strict=True):
            writer.writerow([repr(time), *("" if math.isnan(value) else repr(value) for value in row)])


def _table(path: Path) -> tuple[list[str], list[list[str]], list[int]]:
    """Return the header, the cells by row, and the line number of each row."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise JointIdError(f"{path}: cannot be read ({error.strerror}): check the path and its permissions") from None
    except UnicodeDecodeError as error:
        raise JointIdError(f"{path}: byte {error.start} is not UTF-8 text: save the file as plain CSV") from None
    filled = [(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    if not filled:
        raise JointIdError(f"{path}: the file holds no line: record it again")
    frequent = max(";\t,", key=filled[0][1].count)
    delimiter = frequent if frequent in filled[0][1] else None
    table = [_cells(line, delimiter) for _, line in filled]
    header, numbers = table[0], [k for k, _ in filled]
    if all(_is_number(cell) for cell in header):
        raise JointIdError(
            f"{path}: no header, line {numbers[0]} holds numbers only: put column names above it, {', '.join(TARGETS)} "
            "(SI units) or your own with e.g. --map link_position=q"
        )
    for number, row in zip(numbers, table, strict=False):
        if len(row) != len(header):
            raise JointIdError(
                f"{path}: line {number} has {len(row)} cells, the header has {len(header)}: mend or cut this line"
            )
    if len(table) == 1:
        raise JointIdError(f"{path}: only a header ({', '.join(header)}), no samples: record it again")
    return header, table[1:], numbers[1:]


def _cells(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of one line; the delimiter None splits at spaces."""
    cells = next(csv.reader([line], delimiter=delimiter)) if delimiter and '"' in line else line.split(delimiter)
    return [cell.strip() for cell in cells]


def _column(path: Path, name: str, index: int, rows: list[list[str]], numbers: list[int]) -> Array:
    """Return one column as numbers, NaN for empty cells."""
    try:
        return np.array([float(row[index] or "nan") for row in rows])
    except ValueError:
        row, number = next((r, n) for r, n in zip(rows, numbers, strict=True) if not _is_number(r[index] or "nan"))
        hint = " with a decimal point" if _is_number(row[index].replace(",", ".")) else ", or leave the cell empty"
        raise JointIdError(
            f"{path}: line {number}, column {name}: {row[index]!r} is not a number: write one{hint}"
        ) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
