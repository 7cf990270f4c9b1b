"""`joint-id diff`: what changed between two estimates of a joint."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from joint_id_core.cli.fit_options import JsonOption
from joint_id_core.cli.output import print_json
from joint_id_core.errors import JointIdError


def diff(
    before: Annotated[Path, typer.Argument(help="earlier estimate, from fit --save")],
    after: Annotated[Path, typer.Argument(help="later estimate of the same joint, of another recording")],
    json: JsonOption = False,
) -> None:
    """Compare two estimates of a joint: change of each parameter, its uncertainty, and whether it is more than chance.

    Exit code 0: nothing changed; 1: something did, or an estimate is not a good one; 2: bad input.
    """
    from joint_id_core.results.difference import as_dicts, differences, table
    from joint_id_core.results.estimate import Estimate

    estimates = Estimate.load(before), Estimate.load(after)
    try:
        rows = differences(*estimates)
    except JointIdError as error:
        raise JointIdError(f"{before}, {after}: {error}") from None
    bad = [
        f"{path}: {e.status.value}: its intervals cannot be trusted"
        for path, e in zip((before, after), estimates, strict=True)
        if not e.converged
    ]
    if json:
        print_json({"parameters": as_dicts(rows), "warnings": bad})
    else:
        print("\n".join([table(rows), *bad]))
    if bad or any(row.changed for row in rows):
        raise typer.Exit(1)
