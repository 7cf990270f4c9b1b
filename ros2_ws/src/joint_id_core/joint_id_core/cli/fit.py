"""`joint-id fit`: identify a model from a recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from joint_id_core.cli.arguments import Progress, pairs, print_json
from joint_id_core.cli.fit_options import (
    EndOption,
    FileArgument,
    FixOption,
    FreeOption,
    JointOption,
    JsonOption,
    MapOption,
    PriorOption,
    StartOption,
    given_and_held,
    window,
)
from joint_id_core.cli.group import BAD_INPUT, complain
from joint_id_core.cli.model_options import (
    MODEL_HELP,
    ActuationOption,
    DelaysOption,
    FrictionOption,
    GravityOption,
    KinematicErrorOption,
    OffsetsOption,
    SetOption,
    build_model,
)
from joint_id_core.comparison.model_text import drive_of
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:
    from joint_id_core.estimators.innovations.options import InnovationsOptions


def fit(
    file: FileArgument,
    model: Annotated[str, typer.Option(help=MODEL_HELP)],
    joint: JointOption = None,
    set_: SetOption = None,
    fix: FixOption = None,
    free: FreeOption = None,
    map_: MapOption = None,
    actuation: ActuationOption = None,
    friction: FrictionOption = None,
    gravity: GravityOption = False,
    kinematic_error: KinematicErrorOption = False,
    delays: DelaysOption = False,
    offsets: OffsetsOption = False,
    estimator: Annotated[str, typer.Option(help="innovations or hpinn (needs torch)")] = "innovations",
    cell: Annotated[str, typer.Option(help="rk4, or implicit for stiff joints")] = "rk4",
    prior: PriorOption = None,
    start: StartOption = None,
    end: EndOption = None,
    validate: Annotated[Path | None, typer.Option(help="recording that the fitted model must predict")] = None,
    plot: Annotated[Path | None, typer.Option(help="save a picture of measurement and prediction")] = None,
    json: JsonOption = False,
) -> None:
    """Identify the parameters of a joint model, with standard deviations and verdicts.

    Exit code 0: converged; 1: no convergence or a poor fit; 2: bad input.
    """
    values, fixed = given_and_held(set_, fix)

    from joint_id_core import estimators, formats
    from joint_id_core.results import report
    from joint_id_core.results.estimate import Status

    if plot is not None:
        from joint_id_core.cli.plot import check

        check(plot)
    mapping = pairs(map_ or (), "--map")
    recording = window(formats.read(file, joint, mapping), start, end)
    drive = actuation or drive_of(model, recording)
    built = build_model(
        model, drive, friction, gravity=gravity, kinematic_error=kinematic_error, delays=delays, offsets=offsets
    )
    with Progress() as progress:
        estimate = estimators.fit(
            built, recording, values, fixed, freed=set(free or ()), estimator=estimator, progress=progress,
            options=_options(estimator, cell, prior or []),
        )  # fmt: skip
    result = report.as_dict(
        replace(estimate, start=recording.origin + estimate.start, end=recording.origin + estimate.end)
    )
    text = report.table(estimate)
    if validate is not None and estimate.predictions is not None:
        from joint_id_core.validation.held_out import held_out, held_out_drive

        other = formats.read(validate, joint, mapping)
        nrmse = held_out(built, other, estimate)
        result["validation"] = [{"signal": name, "nrmse": value} for name, value in nrmse.items()]
        text += f"\nheld out, {validate}: " + ", ".join(f"{name} nrmse {v:.3g}" for name, v in nrmse.items())
        explained = held_out_drive(built, other, estimate)
        if explained is not None:
            result["validation"].append({"signal": explained[0], "r_squared": explained[1]})
            text += f", {explained[0]} R^2 {explained[1]:.4f}"
    if plot is not None and estimate.predictions is not None:
        from joint_id_core.cli.plot import save

        save(plot, built, recording, estimate)
    if json:
        print_json(result)
    else:
        print(text)
    if not estimate.converged:
        complain(f"{estimate.status.value}: {estimate.message}")
        unusable = estimate.status in (Status.NO_MOTION, Status.TOO_SHORT, Status.MISSING_SIGNAL)
        raise typer.Exit(BAD_INPUT if unusable else 1)


def _options(estimator: str, cell: str, priors: list[str]) -> InnovationsOptions | None:
    """Options of the innovations estimator, the only one that has these.

    Raises:
        JointIdError: they were given for another estimator, or are not among the choices.
    """
    from joint_id_core.estimators.innovations.options import InnovationsOptions

    if estimator == "innovations":
        return InnovationsOptions(cell=cell, priors=",".join(priors))
    if cell != "rk4" or priors:
        raise JointIdError(f"--cell and --prior are for the innovations estimator: leave them out with {estimator}")
    return None
