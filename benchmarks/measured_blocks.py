"""Measured tables on the pages of docs/: they stand between `<!-- measured: NAME -->` and `<!-- end -->`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent / "docs"
BLOCK = re.compile(r"(<!-- measured: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def written(page: str, tables: Mapping[str, str]) -> str:
    """A page with those of its measured blocks made anew that are in `tables`."""
    return BLOCK.sub(lambda m: f"{m[1]}{tables[m[2]]}\n{m[3]}" if m[2] in tables else m[0], page)


def write(page: str, tables: Mapping[str, str]) -> None:
    """Make measured blocks of a page of docs/ anew, and say so."""
    path = DOCS / page
    path.write_text(written(path.read_text(), tables))
    print(f"wrote {path}")
