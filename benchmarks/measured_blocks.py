"""Measured tables on the pages of docs/: they stand between `<!-- measured: NAME -->` and `<!-- end -->`.

A table may be measured on another machine, as rows in a JSON file, and written where the docs are.
"""

from __future__ import annotations

import json
import os
import re
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

DOCS = Path(__file__).resolve().parent.parent / "docs"
BLOCK = re.compile(r"(<!-- measured: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)
Row = TypeVar("Row")


def written(page: str, tables: Mapping[str, str]) -> str:
    """A page with those of its measured blocks made anew that are in `tables`."""
    return BLOCK.sub(lambda m: f"{m[1]}{tables[m[2]]}\n{m[3]}" if m[2] in tables else m[0], page)


def write(page: str, tables: Mapping[str, str]) -> None:
    """Make measured blocks of a page of docs/ anew, and say so."""
    path = DOCS / page
    path.write_text(written(path.read_text(), tables))
    print(f"wrote {path}")


def add_options(parser: ArgumentParser, page: str) -> None:
    """Add the options of a table that may be measured on another machine."""
    parser.add_argument("--workers", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--json", type=Path, help="where every row goes as soon as it is there")
    parser.add_argument("--from", type=Path, dest="result", help="a result in JSON, of any machine: measure nothing")
    parser.add_argument("--write", action="store_true", help=f"make the table of docs/{page} anew")


def rows_of(args: Namespace, rows: Iterable[Row], row: Callable[[dict[str, Any]], Row]) -> tuple[list[Row], str]:
    """Rows of a table, and the machine in words: those of the result in JSON, or `rows` as they are measured.

    `row` makes a row of what the JSON file has of it.
    """
    if args.result:
        known = json.loads(args.result.read_text())
        return [row(one) for one in known["rows"]], known["machine"]
    found, machine = list[Row](), f"{os.cpu_count()} cores, {args.workers} process{'es' * (args.workers > 1)}."
    for one in rows:
        found.append(one)
        print(one, flush=True)
        if args.json:
            rows_told = [asdict(r) for r in found]  # type: ignore[call-overload]  # rows are dataclasses
            args.json.write_text(json.dumps({"machine": machine, "rows": rows_told}))
    return found, machine
