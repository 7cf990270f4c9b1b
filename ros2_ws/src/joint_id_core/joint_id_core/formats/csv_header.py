"""The lines of a text file, and which of them is the header."""

from __future__ import annotations

import codecs
import csv
import gzip
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from joint_id_core.errors import JointIdError
from joint_id_core.formats.column_names import TIME, factor_of, is_si, is_unit, understood
from joint_id_core.formats.mapping import TARGETS

COMMENTS = ("#", "%", "//")
SEPARATOR = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # the first line of a file that is made for Excel
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
LOOK = 30  # lines, among which the header is: titles may stand above it
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True)
class Header:
    """Names of the columns, the number of the line that holds them, and the delimiter (None: spaces)."""

    names: list[str]
    line: int
    delimiter: str | None


def opened(path: Path) -> TextIO:
    """Open a text file, also a compressed one."""
    return gzip.open(path, "rt", encoding="utf-8-sig") if path.suffix == ".gz" else path.open(encoding="utf-8-sig")


def lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file with their numbers; the message of an error names the path.

    Raises:
        JointIdError: the file cannot be read, or is no text.
    """
    try:
        with opened(path) as file:
            for number, line in enumerate(file, 1):
                if "\0" in line:
                    raise JointIdError(f"{path}: {_about_zeros(number, line)}")
                yield number, line
    except gzip.BadGzipFile:
        raise JointIdError(f"{path}: not compressed, though its name ends in .gz: rename or copy it again") from None
    except OSError as error:
        why = error.strerror or str(error)
        raise JointIdError(f"{path}: cannot be read ({why}): check the path and its permissions") from None
    except EOFError:
        raise JointIdError(f"{path}: the compressed file ends too early: copy it again") from None
    except UnicodeDecodeError as error:
        if error.start == 0 and error.object[:2] in UTF_16:
            raise JointIdError(f"{path}: this is UTF-16 text: save the file as UTF-8") from None
        raise JointIdError(
            f"{path}: byte {error.start} is not UTF-8 text: save the file as UTF-8 (in Excel: CSV UTF-8)"
        ) from None


def _about_zeros(number: int, line: str) -> str:
    """Return what a line with NUL characters is: each second one is in UTF-16, the rest of a file after a power cut."""
    zeros = line.count("\0")
    if number == 1 and 0.3 < zeros / len(line) < 0.7:
        return "this is UTF-16 text: save the file as UTF-8"
    return f"line {number} holds {zeros:,} NUL bytes, as a power cut leaves them: remove this line"


def find_header(path: Path) -> Header:
    """Find the header: the first line that is no comment, or the last comment above it if it holds numbers only.

    Lines of titles above it are skipped if it can be told by its names or by the numbers below.

    Raises:
        JointIdError: no header, a table with a signal in each line, or not a text file.
    """
    comment: tuple[int, str] | None = None
    found: list[Header] = []
    texts: list[str] = []
    for number, line in lines(path):
        text = line.strip()
        if not text or (number == 1 and SEPARATOR.fullmatch(text)):
            continue
        if text.startswith(COMMENTS):
            comment = number, text.lstrip("#%/ ")
            continue
        delimiter = delimiter_of(text)
        found.append(Header(cells(text, delimiter), number, delimiter))
        texts.append(text)
        if len(found) == 1 and all(_is_value(cell) for cell in found[0].names):
            return _in_comment(path, comment, found[0])
        if len(found) == LOOK:
            break
    if not found:
        raise JointIdError(f"{path}: the file holds no line: record it again")
    if 1 < len(found) < len(found[0].names) and all(_is_row_of_a_signal(one.names) for one in found):
        raise JointIdError(
            f"{path}: each line holds a name and numbers, so the table is transposed: write a column for each signal, "
            "below a line of names"
        )
    header = next(filter(_is_clear, found), None) or _above_numbers(found, texts) or found[0]
    return _with_units(header, texts[found.index(header) + 1 :])


def _in_comment(path: Path, comment: tuple[int, str] | None, numbers: Header) -> Header:
    """Return the header in the last comment above a line of numbers."""
    if comment is not None:
        delimiter = delimiter_of(comment[1])
        names = cells(comment[1], delimiter)
        if len(names) == len(numbers.names) and not any(is_number(name) for name in names):
            return Header(names, comment[0], numbers.delimiter)
    raise JointIdError(
        f"{path}: no header, line {numbers.line} holds numbers only: put column names above it, {', '.join(TARGETS)} "
        "(SI units) or your own with e.g. --map link_position=q"
    )


def _with_units(header: Header, below: Sequence[str]) -> Header:
    """Return the header with the units in the line below it, if there is one: added to names that are not in SI."""
    if not below:
        return header
    units = [cell.strip("()[] ") for cell in cells(below[0], header.delimiter)]
    times = any(factor_of(TIME, unit) for unit in units if unit)
    if not times or len(units) != len(header.names) or not all(unit in ("", "-") or is_unit(unit) for unit in units):
        return header
    pairs = zip(header.names, units, strict=True)
    names = [name if unit in ("", "-") or is_si(name, unit) else f"{name} [{unit}]" for name, unit in pairs]
    return Header(names, header.line + 1, header.delimiter)


def _is_clear(line: Header) -> bool:
    """Return whether a line names time and a channel."""
    targets = {known[0] for name in line.names if (known := understood(name)) is not None}
    return TIME in targets and len(targets) > 1


def _is_row_of_a_signal(row: Sequence[str]) -> bool:
    return not _is_value(row[0]) and all(_is_value(cell) for cell in row[1:])


def _above_numbers(found: Sequence[Header], texts: Sequence[str]) -> Header | None:
    """Return the first of the lines of names that has as many cells as the numbers below them; None if none has."""
    for above, below in zip(found, texts[1:], strict=False):
        count = len(above.names)
        values = cells(below, above.delimiter)
        numbers = sum(_is_value(cell or "nan") for cell in values)
        if _is_text(above) and len(values) == count and 2 * numbers > count:
            alike = (one for one in found if one.delimiter == above.delimiter and len(one.names) == count)
            return next(filter(_is_text, alike))
    return None


def _is_text(line: Header) -> bool:
    return len(line.names) > 1 and not any(_is_value(cell) for cell in line.names)


def delimiter_of(line: str) -> str | None:
    """Return the delimiter of a line; None for spaces."""
    frequent = max(";\t,|", key=line.count)
    return frequent if frequent in line else None


def cells(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of one line; the delimiter None splits at spaces."""
    line = line.rstrip("\r\n")
    if delimiter == "|":  # a table in text has one at both ends
        line = line.strip().removeprefix("|").removesuffix("|")
    split = next(csv.reader([line], delimiter=delimiter)) if delimiter and '"' in line else line.split(delimiter)
    return [cell.strip() for cell in split]


def _is_value(cell: str) -> bool:
    return is_number(cell) or DECIMAL_COMMA.fullmatch(cell) is not None


def is_number(text: str) -> bool:
    """Return whether a cell is a number with a decimal point."""
    try:
        float(text)
    except ValueError:
        return False
    return True
