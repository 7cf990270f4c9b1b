"""CSV files: a header, then one line per sample.

Columns are `time_s` and any of `joint_id_core.data.signals.CHANNELS`, in SI units, or written as people do (see
`column_names`), or those of several joints (`joint_columns`). A signal without a column was not measured; an empty
cell, `nan`, `NA`, `N/A`, `null` and `none` are missing values. Other columns are ignored unless a mapping names them.
The delimiter (comma, semicolon, tab, bar or spaces) is found from the header. Where it is a semicolon or a tab, numbers
may have decimal commas. Lines that begin with #, % or // are comments; which line is the header, see `csv_header`. A
last line that was cut short, as where a program was killed, is left out.
"""

from __future__ import annotations

import csv
import logging
import math
import re
import warnings
from collections.abc import Collection, Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.formats import joint_columns
from joint_id_core.formats.column_names import TIME
from joint_id_core.formats.csv_header import COMMENTS, DECIMAL_COMMA, Header, cells, find_header, is_number, lines
from joint_id_core.formats.damaged import tells_damage
from joint_id_core.formats.last_line import is_cut, largest, seems_cut, size, unended
from joint_id_core.formats.mapping import plan
from joint_id_core.formats.mapping import taken as in_words
from joint_id_core.formats.mapping import unread as left_alone
from joint_id_core.formats.overlooked import tell, tell_empty

log = logging.getLogger(__name__)
SHOWN = 40  # characters of a cell that an error shows
THOUSANDS = re.compile(r"[+-]?\d{1,3}([.,' ]\d{3})+([.,]\d*)?")
COMMAS = (";", "\t")  # delimiters of tables whose numbers may have decimal commas, as Excel writes them in Europe
MISSING = ("", "na", "n/a", "#n/a", "null", "none")  # cells without a value, as other programs write them
CLOCK = re.compile(r"\d:\d\d|\d{4}-\d\d-\d\d|\d\d?[./]\d\d?[./]\d")  # in a date, or a time of the day


@tells_damage
def read(path: Path, joint: str, mapping: Mapping[str, str]) -> Recording:
    """Read a CSV file; `mapping` as in `joint_id_core.formats.read`.

    Raises:
        JointIdError: no usable header, a line of the wrong length, a cell that is not a number. The message names file,
            line and column.
    """
    header = find_header(path)
    products = plan(path, header.names, joint_columns.columns(path, header.names, joint, mapping))
    used = list(dict.fromkeys(name for product in products.values() for name in product.names))
    for name in used:
        if header.names.count(name) > 1:
            raise JointIdError(f"{path}: {header.names.count(name)} columns are called {name!r}: rename all but one")
    tell(path, [name for name in header.names if name not in used], products)
    columns = _columns(path, header, used)
    values: dict[str, Array] = {}
    for target, product in products.items():
        values[target] = np.prod([columns[name] for name in product.names], axis=0)
        if product.factor != 1.0:
            values[target] = product.factor * values[target]
    recording = Recording(values.pop(TIME), values, source=str(path), joint=joint)
    tell_empty(recording)
    return recording


@tells_damage
def columns(path: Path) -> tuple[str, ...]:
    """Return the column names in the header.

    Raises:
        JointIdError: no header, or not a text file.
    """
    return tuple(find_header(path).names)


def write_csv(path: str | Path, recording: Recording) -> None:
    """Write time and the measured channels; every number reads back exactly, NaN becomes an empty cell.

    Derived channels are left out: a CSV file cannot mark them, so they would read back as measurements.

    Raises:
        JointIdError: the file exists or cannot be written, or the recording has no measured channel.
    """
    path = Path(path)
    if path.exists():
        raise JointIdError(f"{path} exists already: remove it or choose another name")
    names = [name for name in recording.channels if name not in recording.derived]
    if not names:
        raise JointIdError(f"{recording.source} has no measured channel: nothing to write to {path}")
    table = zip(*(recording[name].tolist() for name in names), strict=True)
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([TIME, *names])
            for time, row in zip(recording.time.tolist(), table, strict=True):
                writer.writerow([repr(time), *("" if math.isnan(value) else repr(value) for value in row)])
    except OSError as error:
        path.unlink(missing_ok=True)
        raise JointIdError(
            f"{path}: cannot be written: {error.strerror}: check folder, permissions and space"
        ) from None


def _numbers(path: Path, header: Header) -> Array | None:
    """Return all cells as numbers (rows, columns), read by NumPy; None if a cell or a line is not as it expects."""
    try:
        last = unended(path)
    except (OSError, EOFError):  # a compressed file may be damaged: the other reader says how
        return None
    row = cells(last, header.delimiter)
    short = last and len(row) < len(header.names)  # NumPy would refuse all
    rows = _count(path) - 1 - header.line if short else None
    if rows == 0:
        return None
    # NumPy reads a file that it opens itself in larger pieces; with comments it takes every line apart in Python.
    for comments in (None, COMMENTS):
        try:
            with warnings.catch_warnings(action="ignore"):  # no rows: said below
                table = np.loadtxt(
                    path, delimiter=header.delimiter, skiprows=header.line, comments=comments, ndmin=2,
                    encoding="utf-8-sig", max_rows=rows,
                )  # fmt: skip
        except (ValueError, OSError, EOFError):
            continue
        if not len(table) or table.shape[1] != len(header.names) or (last and comments):
            return None
        if last and seems_cut(path, header, row):
            _tell_cut(path, _count(path))
            return table if short else table[:-1]
        return table
    return None


def _count(path: Path) -> int:
    """Return the number of lines."""
    return sum(1 for _ in lines(path))


def _table(path: Path, header: Header) -> tuple[list[list[str]], list[int]]:
    """Return the cells by row, and the line number of each row; without a last line that was cut short."""
    rows, numbers = [], []
    for number, line in lines(path):
        text = line.strip()
        if number <= header.line or not text or text.startswith(COMMENTS):
            continue
        row = cells(line, header.delimiter)
        if len(row) != len(header.names) and (line.endswith("\n") or len(row) > len(header.names)):
            raise JointIdError(
                f"{path}: line {number} has {len(row)} cells, the header has {len(header.names)}: mend or cut this line"
            )
        rows.append(row)
        numbers.append(number)
    open_end = rows and numbers[-1] == number and not line.endswith("\n")
    if open_end and is_cut(rows[-1], len(header.names), largest(size(row[-1]) for row in rows[:-1])):
        _tell_cut(path, number)
        del rows[-1], numbers[-1]
    if not rows:
        raise JointIdError(f"{path}: only a header ({', '.join(header.names)}), no samples: record it again")
    return rows, numbers


@lru_cache(maxsize=100)
def _tell_cut(path: Path, number: int) -> None:
    """Log that the last line is left out: once, as each joint of a table is read by itself."""
    text = (
        "%s: line %d is left out, as the file seems to be cut short within it: if it is whole, end it with a line end"
    )
    log.warning(text, path, number)


def _columns(path: Path, header: Header, used: Collection[str]) -> dict[str, Array]:
    """Return the columns that are used, by name."""
    table = _numbers(path, header)
    if table is not None:
        return {name: table[:, header.names.index(name)].copy() for name in used}
    rows, numbers = _table(path, header)  # slower, with empty cells, and says what is wrong and where
    places = {name: header.names.index(name) for name in used}
    if header.delimiter in COMMAS and not _has_points(rows, places.values()):
        rows = [[c.replace(",", ".") if DECIMAL_COMMA.fullmatch(c) else c for c in row] for row in rows]
    return {name: _column(path, name, place, rows, numbers) for name, place in places.items()}


def _has_points(rows: list[list[str]], places: Collection[int]) -> bool:
    """Return whether a cell in these columns is a number with a point: a comma may then separate thousands."""
    return any("." in row[k] and is_number(row[k]) for row in rows for k in places)


@tells_damage
def joints(path: Path, mapping: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the joints of a table of several; () for a file of one unnamed joint."""
    return joint_columns.joints(path, find_header(path).names, mapping)


@tells_damage
def taken(path: Path, joint: str, mapping: Mapping[str, str]) -> list[str]:
    """Return in words which columns with other names are read as which channels."""
    names = find_header(path).names
    if not joint and (of_all := joint_columns.in_words(path, names, mapping)):
        return of_all
    return in_words(plan(path, names, joint_columns.columns(path, names, joint, mapping)))


@tells_damage
def unread(path: Path, mapping: Mapping[str, str]) -> list[str]:
    """Return the columns that no joint reads."""
    names = find_header(path).names
    found = joint_columns.joints(path, names, mapping) or ("",)
    return left_alone(names, [plan(path, names, joint_columns.columns(path, names, one, mapping)) for one in found])


def _missing_as_nan(cell: str) -> str:
    return "nan" if cell.lower() in MISSING else cell


def _column(path: Path, name: str, index: int, rows: list[list[str]], numbers: list[int]) -> Array:
    """Return one column as numbers, NaN for cells without a value."""
    try:
        return np.array([float(_missing_as_nan(row[index])) for row in rows])
    except ValueError:
        pairs = zip(rows, numbers, strict=True)
        row, number = next((r, n) for r, n in pairs if not is_number(_missing_as_nan(r[index])))
        cell = row[index]
        shown = cell if len(cell) <= SHOWN else f"{cell[:SHOWN]}..."
        what = "is not a number: write one, or leave the cell empty"
        if DECIMAL_COMMA.fullmatch(cell):
            what = "is not a number: write one with a decimal point"
        elif CLOCK.search(cell):
            what = "is a date or a time of the day: write seconds, such as those since the first sample"
        elif THOUSANDS.fullmatch(cell):
            what = "is not a number: write one without separators of thousands"
        raise JointIdError(f"{path}: line {number}, column {name}: {shown!r} {what}") from None
