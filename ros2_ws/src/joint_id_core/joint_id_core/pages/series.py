"""Plots as plain data for the script of a page, thinned so that a page stays small."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.results.plot import broken

MOST = 1500  # points of a curve: more than a screen has, so that one can zoom in
DIGITS = 5  # significant ones of a value; those of the abscissa are two more


def plot(
    title: str, x: Array, rows: Mapping[str, Array], x_label: str = "time [s]", dots: tuple[str, ...] = (),
    bands: Mapping[str, Array] | None = None, log: bool = False, most: int = MOST,
) -> dict[str, Any]:  # fmt: skip
    """Return one plot of rows (T,) by name over x (T,).

    Args:
        title: with the unit.
        x, rows: gaps of x end a line; NaN is left out.
        x_label: of the abscissa.
        dots: names of rows that are drawn as points.
        bands: by name of a row, the half width of the band around it, shape (T,).
        log: both axes are logarithmic.
        most: points of a curve, about.
    """
    names, widths = list(rows), dict(bands or {})
    table = [rows[n] for n in names] + [rows[n] + sign * w for n, w in widths.items() for sign in (-1.0, 1.0)]
    time, *values = broken(x, *table) if not log else (x, *table)
    kept = thinned(np.array(values), most)
    shown = [[_number(v, DIGITS) for v in row[kept].tolist()] for row in values]
    series = [{"name": n, "dots": n in dots} for n in names]
    return {
        "title": title, "x_label": x_label, "log": log, "series": series,
        "bands": [names.index(n) for n in widths],
        "data": [[_number(v, DIGITS + 2) for v in _filled(time)[kept].tolist()], *shown],
    }  # fmt: skip


def thinned(values: Array, most: int = MOST) -> NDArray[np.int64]:
    """Return indices of at most about `most` columns of values (k, T), with the extremes of each row and every gap."""
    count = values.shape[1]
    if count <= most:
        return np.arange(count, dtype=np.int64)
    edges = np.linspace(0, count, max(2, most // (2 * len(values))) + 1).astype(int)
    kept = [0, count - 1]
    for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        for row in values[:, begin:end]:
            known = np.flatnonzero(np.isfinite(row))
            if len(known):
                kept += [begin + int(known[np.argmin(row[known])]), begin + int(known[np.argmax(row[known])])]
        lost = np.flatnonzero(~np.isfinite(values[:, begin:end]).any(axis=0))
        kept += [begin + int(lost[0])] if len(lost) else []
    return np.unique(kept).astype(np.int64)


def _filled(time: Array) -> Array:
    """Return instants with those of gaps between their neighbours: a plot needs a number there."""
    lost = np.flatnonzero(~np.isfinite(time))
    filled = time.copy()
    filled[lost] = 0.5 * (time[lost - 1] + time[np.minimum(lost + 1, len(time) - 1)])
    return filled


def _number(value: float, digits: int) -> float | None:
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
