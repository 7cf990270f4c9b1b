"""A page as one file: sections of HTML, with styles, script and data inside; it fetches nothing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import Any

from joint_id_core.pages.series import MOST
from joint_id_core.results.estimate import Status

# A page may only use what is in it; a live one may also ask where it came from.
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
LIVE_POLICY = f"{POLICY}; connect-src 'self'; form-action 'none'; base-uri 'none'"


class Page:
    """A page that grows section by section.

    Attributes:
        points: of a curve, about.
    """

    def __init__(self, title: str, live: Sequence[str] = (), points: int = MOST) -> None:
        """Begin a page; `live` names the scripts of one that goes on."""
        self._title, self._live, self.points = title, live, points
        self._body: list[str] = []
        self._plots: list[dict[str, Any]] = []

    def section(self, title: str, *parts: str) -> None:
        """Add a section of HTML; nothing without parts."""
        if parts:
            self._body.append(f"<section><h2>{escape(title)}</h2>{''.join(parts)}</section>")

    def head(self, *parts: str, anchor: str = "") -> None:
        """Add what stands above the sections that follow; `anchor` is its name for links."""
        name = f' id="{escape(anchor)}"' if anchor else ""
        self._body.append(f"<header{name}>{''.join(parts)}</header>")

    def figure(self, plot: dict[str, Any]) -> str:
        """Return the place of a plot (`series.plot`), whose data are kept for the script."""
        self._plots.append(plot)
        return f'<figure data-plot="{len(self._plots) - 1}"><figcaption>{escape(plot["title"])}</figcaption></figure>'

    def html(self) -> str:
        """Return the page."""
        data = json.dumps(self._plots, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
        policy = LIVE_POLICY if self._live else POLICY
        more = "".join(f"\n<script>{_asset(name)}</script>" for name in self._live)
        return (
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
            f"<title>{escape(self._title)}</title>"
            f"<style>{_asset('uPlot.min.css')}{_asset('style.css')}</style></head>\n"
            f"<body>{''.join(self._body)}\n"
            f'<script id="plots" type="application/json">{data}</script>\n'
            f"<!-- uPlot: {_asset('uPlot.LICENSE.txt')} -->\n"
            f"<script>{_asset('uPlot.iife.min.js')}</script>\n<script>{_asset('plots.js')}</script>{more}</body></html>\n"
        )


def paragraph(text: str) -> str:
    """Return a paragraph of text."""
    return f"<p>{escape(text)}</p>"


def listed(texts: Iterable[str]) -> str:
    """Return a list; empty for no texts."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""


def table(head: Sequence[str], rows: Iterable[Sequence[str]], below: Sequence[str] = ()) -> str:
    """Return a table of text.

    Args:
        head: of its columns.
        rows: of cells.
        below: looks of the last columns, which a narrow screen shows below the others: "text" takes a line of its own,
            "word" begins the line of the text after it, "more" goes on in a second line. Without them a narrow screen
            scrolls the table.
    """
    return table_of_html(head, ([escape(cell) for cell in row] for row in rows), below)


def table_of_html(head: Sequence[str], rows: Iterable[Iterable[str]], below: Sequence[str] = ()) -> str:
    """Return a table like `table`, whose cells are HTML below the head."""
    first = len(head) - len(below)
    looks = [""] * first + [f' class="{look}"' for look in below]
    top = "".join(f"<th{look}>{escape(cell)}</th>" for cell, look in zip(head, looks, strict=True))
    body = "".join(
        f"<tr>{''.join(f'<td{look}>{cell}</td>' for cell, look in zip(row, looks, strict=True))}</tr>" for row in rows
    )
    table_ = f'<table style="--columns:{first}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'
    return f'<div class="wide">{table_}</div>'


def badge(status: Status) -> str:
    """Return a status as a coloured mark."""
    look = "good" if status is Status.CONVERGED else "fair" if status is Status.DISAGREE else ""
    return f'<span class="status {look}">{escape(status.value)}</span>'


def _asset(name: str) -> str:
    return (files("joint_id_core.pages") / "assets" / name).read_text(encoding="utf-8")
