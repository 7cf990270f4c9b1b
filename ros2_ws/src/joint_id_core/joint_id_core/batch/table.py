"""The table of a batch: what is finished, in it and in the parts beside it, and how both become one table."""

from __future__ import annotations

import hashlib
import heapq
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from typing import Any, BinaryIO, NamedTuple

from joint_id_core.batch.recordings import Found
from joint_id_core.batch.row import FAILED, MARK, VERSION, Row, schema
from joint_id_core.batch.store import ENDING, Store, store
from joint_id_core.errors import JointIdError
from joint_id_core.results.history import Known
from joint_id_core.results.status import Status
from joint_id_core.results.verdict import Verdict

PARQUET = b"PAR1"  # how such a file begins
BLOCK = 2000  # rows that are in memory at once


class Version(NamedTuple):
    """State of the files of a recording when it was fitted, and whether that failed."""

    size_bytes: int
    modified: str
    failed: bool


@dataclass
class Finished:
    """What is finished: by recording its version, for those in parts also the name of the part."""

    versions: dict[str, Version] = field(default_factory=dict)
    parts: dict[str, str] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)  # what was found damaged and set aside

    def has(self, found: Found, again: bool) -> bool:
        """Return whether a recording need not be fitted; with `again`, failed ones are."""
        known = self.versions.get(found.place)
        return known is not None and known[:2] == (found.size_bytes, found.modified) and not (again and known.failed)


def libraries() -> Any:
    """Return `pyarrow.parquet`.

    Raises:
        JointIdError: it is not installed.
    """
    try:
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise JointIdError("tables need the package pyarrow: pip install pyarrow") from None
    return pyarrow.parquet


def opened(file: BinaryIO, name: str) -> Any:
    """Return a table that a batch wrote (`pyarrow.parquet.ParquetFile`).

    Raises:
        JointIdError: it is a whole table of another kind, or no table at all.
        ValueError: it is damaged, or half-written.
    """
    parquet = libraries()
    begin = file.read(len(PARQUET))
    if begin.strip(b"\0") and begin != PARQUET[: len(begin)]:  # no accident makes this of a table
        raise JointIdError(f"{name}: a file that is no table (Parquet): give another name, or move it away")
    file.seek(0)
    try:
        table = parquet.ParquetFile(file)
    except JointIdError:
        raise
    except Exception as error:  # pyarrow raises many kinds of errors on damaged bytes
        raise ValueError(" ".join(str(error).split())) from None
    mark = (table.schema_arrow.metadata or {}).get(MARK)
    if mark != VERSION:
        what = "of another version of joint_id" if mark else "that joint-id batch did not write"
        raise JointIdError(f"{name}: a table {what}: give another name, or move it away")
    return table


def write_part(store: Store, rows: Sequence[Row], found: Found) -> str:
    """Write the rows of a recording; return the name of the part, which a second writing replaces."""
    name = _part_of(found.place)
    store.put(name, json.dumps(list(rows), allow_nan=False).encode())
    return name


def _part_of(place: str) -> str:
    return hashlib.sha256(place.encode()).hexdigest()[:32] + ENDING


def finished(store: Store, options: str) -> Finished:
    """Return what is finished; a damaged table or part is set aside.

    Raises:
        JointIdError: it was made with other options, or cannot be read.
    """
    found = Finished()
    if (file := store.table()) is not None:
        try:
            with file:
                _index_table(opened(file, store.name), store.name, options, found)
        except ValueError as error:
            if isinstance(error, JointIdError):
                raise
            found.versions.clear()
            found.said.append(f"{store.name} is damaged or half-written ({error}): kept as {store.set_aside()}")
    for part in store.parts():
        try:
            rows = json.loads(store.get(part))
            place, version = rows[0]["recording"], _version(rows)
            if part != _part_of(place):
                raise ValueError("it is of another recording")
        except (ValueError, KeyError, IndexError, TypeError):
            found.said.append(f"a part of {store.name} is damaged: kept as {store.set_aside(part)}")
            continue
        _require_same(rows[0]["options"], options, store.name)
        found.versions[place], found.parts[place] = version, part
    return found


def _index_table(table: Any, name: str, options: str, found: Finished) -> None:
    for batch in table.iter_batches(BLOCK, columns=["recording", "size_bytes", "modified", "status", "options"]):
        for row in batch.to_pylist():
            _require_same(row["options"], options, name)
            version = _version([row])
            before = found.versions.get(row["recording"], version)
            found.versions[row["recording"]] = version._replace(failed=version.failed or before.failed)


def _version(rows: Sequence[Row]) -> Version:
    return Version(rows[0]["size_bytes"], rows[0]["modified"], any(row["status"] in FAILED for row in rows))


def _require_same(before: str, now: str, name: str) -> None:
    if before != now:
        raise JointIdError(f"{name} was made with other options ({before}), now they are {now}: give another -o")


def join(store: Store, parts: dict[str, str]) -> Counter[str]:
    """Write one table of the old one and of the parts, which replace old rows; return how many rows have which status.

    It is sorted by recording; the joints of one are in the order of its file. No more than some thousand rows are in
    memory at once.
    """
    import pyarrow as pa

    columns, counts = schema(), Counter[str]()
    with store.draft() as draft:
        file = store.table()
        old = opened(file, store.name) if file is not None else None
        with libraries().ParquetWriter(draft, columns, compression="zstd") as writer:
            block: list[Row] = []
            for rows in heapq.merge(_of_table(old, parts), _of_parts(store, parts), key=lambda r: r[0]["recording"]):
                block += rows
                counts.update(row["status"] for row in rows)
                if len(block) >= BLOCK:
                    writer.write_table(pa.Table.from_pylist(block, columns))
                    block = []
            if block:
                writer.write_table(pa.Table.from_pylist(block, columns))
        if file is not None:
            file.close()
    return counts


def _of_table(table: Any, replaced: dict[str, str]) -> Iterator[list[Row]]:
    """Yield the rows of a table, recording by recording, without those that are replaced."""
    if table is None:
        return
    rows = (row for batch in table.iter_batches(BLOCK) for row in batch.to_pylist())
    for place, group in groupby(rows, key=itemgetter("recording")):
        if place not in replaced:
            yield list(group)


def _of_parts(store: Store, parts: dict[str, str]) -> Iterator[list[Row]]:
    for place in sorted(parts):
        yield json.loads(store.get(parts[place]))


def waiting(output: str) -> str:
    """Return in words that recordings are finished and not in the table yet; nothing if there are none."""
    count = len(store(output).parts())
    if not count:
        return ""
    which = f"{count} finished recording{' is' if count == 1 else 's are'}"
    return f"{which} not in {output} yet: wait for its joint-id batch, or give that again if it was ended: it goes on"


def known(output: str) -> tuple[list[Known], int, int]:
    """Return what the converged rows of a table know, how many rows there are, and how many of them are left out.

    Raises:
        JointIdError: there is no table, or it cannot be read.
    """
    file = store(output).table()
    if file is None:
        raise JointIdError(waiting(output) or f"{output}: no such table: make one with joint-id batch")
    columns = ["robot", "joint", "status", "model", "end_s", "parameters"]
    found, rows, left = list[Known](), 0, 0
    with file:
        try:
            table = opened(file, output)
        except JointIdError:
            raise
        except ValueError as error:
            raise JointIdError(f"{output} is damaged or half-written ({error}): make it again") from None
        for batch in table.iter_batches(BLOCK, columns=columns):
            for row in batch.to_pylist():
                rows += 1
                if row["status"] != Status.CONVERGED.value:
                    left += 1
                    continue
                found += [
                    Known(row["robot"], row["joint"] or "joint", row["model"], p["name"], p["unit"],
                          row["end_s"] or 0.0, p["value"], p["std_dev"])
                    for p in row["parameters"]
                    if p["verdict"] == Verdict.ESTIMATED.value and p["std_dev"]
                ]  # fmt: skip
    return found, rows, left
