"""The last line of a table if it has no line end: is it whole, or was it cut short, as where a program was killed?"""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.formats.csv_header import COMMENTS, Header

Indices = NDArray[np.intp]
BLOCK = 1 << 24  # bytes that are looked at together
LINE_END, POINT = ord("\n"), ord(".")


def unended(path: Path) -> str:
    """Return the last line if it has no line end and is no comment; else nothing."""
    line = b""
    with _opened(path) as file:
        if path.suffix != ".gz":
            file.seek(max(0, path.stat().st_size - BLOCK))
        for block in _blocks(file):
            _, end, rest = block.rpartition(b"\n")
            line = rest if end else line + rest
    text = line.decode("utf-8-sig", errors="replace").strip()
    return "" if text.startswith(COMMENTS) else text


class Size(NamedTuple):
    """Characters of a cell, or most in a column, and those after the point."""

    length: int
    decimals: int


def size(cell: str) -> Size:
    """Return the size of a cell."""
    return Size(len(cell), len(cell.replace(",", ".").partition(".")[2]))


def largest(sizes: Iterable[Size]) -> Size:
    """Return the largest length, and the most decimals."""
    lengths, decimals = zip(Size(0, 0), *sizes, strict=True)
    return Size(max(lengths), max(decimals))


def is_cut(row: Sequence[str], count: int, others: Size) -> bool:
    """Return whether a row lacks some of `count` cells, or digits of the last, if others have up to this size.

    What is as long as the longest number in its column, or has as many decimals, lacks nothing that matters.
    """
    if len(row) < count:
        return True
    own = size(row[-1])
    return own.length < others.length and (own.decimals < others.decimals or not others.decimals)


def seems_cut(path: Path, header: Header, row: Sequence[str]) -> bool:
    """Return `is_cut` of the last row, held against all others: those of a table without comments and quotes."""
    found, rest = Size(0, 0), b""
    with _opened(path) as file:
        for _ in range(header.line):
            file.readline()
        for block in _blocks(file):
            whole, end, rest = (rest + block).rpartition(b"\n")
            if end:
                found = largest([found, _largest(np.frombuffer(whole + end, np.uint8), header.delimiter)])
            if found.decimals and is_cut(row, len(header.names), found):
                return True
    return is_cut(row, len(header.names), found)


def _largest(text: Array, delimiter: str | None) -> Size:
    """Return the largest size of the last cells in lines that have their ends."""
    ends = np.flatnonzero(text == LINE_END)
    marks = text == LINE_END
    for character in "\t " if delimiter is None else delimiter:
        marks |= text == ord(character)
    while (spaces := (ends > 0) & _space(text[ends - 1])).any():
        ends = ends - spaces
    begins, points = _after_last(marks, ends), _after_last(text == POINT, ends)
    decimals = (ends - points)[points > begins]
    while (spaces := (begins < ends) & _space(text[begins])).any():
        begins = begins + spaces
    return Size(int(np.max(ends - begins, initial=0)), int(np.max(decimals, initial=0)))


def _space(characters: Array) -> NDArray[np.bool_]:
    return np.asarray((characters == ord(" ")) | (characters == ord("\t")) | (characters == ord("\r")))


def _after_last(marks: NDArray[np.bool_], ends: Indices) -> Indices:
    """Return the place after the last of the marks before each of `ends`; 0 where there is none."""
    places = np.concatenate([[-1], np.flatnonzero(marks)])
    return np.asarray(places[np.searchsorted(places, ends) - 1] + 1)


def _opened(path: Path) -> BinaryIO:
    return gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")  # type: ignore[return-value]


def _blocks(file: BinaryIO) -> Iterator[bytes]:
    return iter(partial(file.read, BLOCK), b"")
