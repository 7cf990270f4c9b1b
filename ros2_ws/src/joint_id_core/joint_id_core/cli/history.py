"""`joint-id history`: how the parameters of joints went over the estimates in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.cli.fit_options import JsonOption
from joint_id_core.cli.group import complain
from joint_id_core.cli.output import print_json
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:
    from joint_id_core.results.history import Course


def history(
    folder: Annotated[Path, typer.Argument(help="folder with estimates, from fit --save")],
    plot: Annotated[Optional[Path], typer.Option(help="save a picture, a row a joint")] = None,
    json: JsonOption = False,
) -> None:
    """Show how the parameters of joints went over the estimates in a folder: first, last, trend a day.

    Files that hold no estimate are named on stderr and left out.
    """
    from joint_id_core.results.estimate import Estimate
    from joint_id_core.results.history import courses, table
    from joint_id_core.results.plot import require_writable

    if not folder.is_dir():
        raise JointIdError(f"{folder}: no such folder: give one with files of fit --save")
    if plot is not None:
        require_writable(plot)
    estimates = []
    for path in sorted(folder.rglob("*.json")):
        try:
            estimates.append(Estimate.load(path))
        except JointIdError as error:
            complain(f"left out: {error}")
    bad = [e for e in estimates if not e.converged]
    if bad:
        complain(f"left out: {len(bad)} of {len(estimates)} estimates, which are not good ones")
    found = courses(estimates)
    if not found:
        raise JointIdError(f"{folder}: no good estimate in it: save some with joint-id fit FILE --save NAME.json")
    if json:
        print_json({"courses": [_as_dict(c) for c in found]})
    else:
        print(table(found))
    if plot is not None:
        from joint_id_core.results.history_plot import save

        save(plot, found)


def _as_dict(c: Course) -> dict[str, object]:
    return {
        "joint": c.joint, "name": c.name, "unit": c.unit, "days": c.days.tolist(), "values": c.values.tolist(),
        "std_devs": c.std_devs.tolist(), "slope_a_day": c.slope, "slope_std_dev": c.slope_std_dev, "trend": c.trend,
    }  # fmt: skip
