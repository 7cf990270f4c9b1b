"""`joint-id history`: how the parameters of joints went, over the estimates in a folder or the table of a batch."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.cli.fit_options import JsonOption
from joint_id_core.cli.group import complain
from joint_id_core.cli.output import print_json
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:
    from joint_id_core.results.history import Course, Known


def history(
    sources: Annotated[
        list[str],
        typer.Argument(help="folder with estimates, from fit --save; or these files; or a table, from batch"),
    ],
    plot: Annotated[Optional[Path], typer.Option(help="save a picture, a row a joint", readable=False)] = None,
    json: JsonOption = False,
) -> None:
    """Show how the parameters of joints went: first, last, trend a day; and joints unlike those of other robots.

    Files that hold no estimate are named on stderr and left out. Of a table with six robots or more, each joint is
    compared with the same joint of the others.
    """
    from dataclasses import asdict

    from joint_id_core.results.fleet import apart
    from joint_id_core.results.history import courses, table
    from joint_id_core.results.plot import require_writable

    if plot is not None:
        require_writable(plot)
    rows = _of_table(sources[0]) if len(sources) == 1 and not _is_json(sources[0]) else _of_files(map(Path, sources))
    found = courses(rows)
    if not found:
        raise JointIdError(
            f"{', '.join(sources)}: no good estimate in it: save some with joint-id fit FILE --save NAME.json"
        )
    outliers = apart(found)
    if json:
        print_json({"courses": [_as_dict(c) for c in found], "apart": [asdict(a) for a in outliers]})
    else:
        print(table(found))
        for one in outliers:
            print(f"unlike the others: {one.text}")
    if plot is not None:
        from joint_id_core.results.history_plot import save

        save(plot, found)


def _is_json(source: str) -> bool:
    """Return whether it is a folder, or a file of one estimate."""
    return Path(source).is_dir() or source.lower().endswith(".json")


def _of_files(sources: Iterable[Path]) -> list[Known]:
    from joint_id_core.results.estimate import Estimate
    from joint_id_core.results.history import known

    estimates, sources = [], list(sources)
    for folder in filter(Path.is_dir, sources):
        os.listdir(folder)  # one that may not be read seems to be empty below
    paths = {path for source in sources for path in (source.rglob("*.json") if source.is_dir() else (source,))}
    for path in sorted(paths, key=_in_order):
        try:
            estimates.append(Estimate.load(path))
        except JointIdError as error:
            complain(f"left out: {error}")
    bad = [e for e in estimates if not e.converged]
    if bad:
        complain(f"left out: {len(bad)} of {len(estimates)} estimates, which are not good ones")
    return known(estimates)


def _in_order(path: Path) -> list[tuple[str, int]]:
    """Return what a path is sorted by: numbers in it count as such, week2 before week10."""
    return [(word, int(part or 0)) for word, part in re.findall(r"(\D+)(\d*)", f"/{path}")]


def _of_table(source: str) -> list[Known]:
    from joint_id_core.batch.table import PARQUET, known, waiting
    from joint_id_core.formats.remote import is_url

    more = waiting(source)
    if not is_url(source) and not Path(source).exists() and not more:
        raise JointIdError(f"{source}: no such folder or table: give one with files of fit --save, or a table of batch")
    if Path(source).is_file() and not source.endswith(".parquet"):
        with Path(source).open("rb") as file:
            if file.read(len(PARQUET)) != PARQUET:
                raise JointIdError(f"{source}: no table of batch: give one, or files of fit --save (.json)")
    found, rows, left = known(source)
    if more:
        complain(more)
    if left:
        complain(f"left out: {left} of {rows} rows, which are no good estimates")
    return found


def _as_dict(c: Course) -> dict[str, object]:
    return {
        "robot": c.robot, "joint": c.label, "name": c.name, "unit": c.unit, "days": c.days.tolist(),
        "values": c.values.tolist(), "std_devs": c.std_devs.tolist(), "slope_a_day": c.slope if c.dated else math.nan,
        "slope_std_dev": c.slope_std_dev if c.dated else math.nan, "trend": c.trend,
    }  # fmt: skip
