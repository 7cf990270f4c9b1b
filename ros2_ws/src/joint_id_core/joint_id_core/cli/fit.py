"""`joint-id fit`: identify a model from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from joint_id_core.cli.arguments import Progress, numbers, pairs, print_json
from joint_id_core.cli.group import BAD_INPUT, complain
from joint_id_core.cli.model_options import (
    MODEL_HELP,
    ActuationOption,
    FrictionOption,
    GravityOption,
    KinematicErrorOption,
    SetOption,
    Texts,
    build_model,
    drive_of,
)
from joint_id_core.errors import JointIdError

if TYPE_CHECKING:
    from joint_id_core.recording import Recording

FixOption = Annotated[Texts, typer.Option("--fix", help="NAME or NAME=VALUE: hold this parameter")]
FreeOption = Annotated[Texts, typer.Option("--free", help="NAME: estimate this parameter that the model holds")]
MAP_HELP = "channel=column, or a product: torque=gtau*vir; of a bag channel=topic.field"
MapOption = Annotated[Texts, typer.Option("--map", help=MAP_HELP)]
Seconds = float | None


def fit(
    file: Annotated[Path, typer.Argument(help="CSV, MAT or bag")],
    model: Annotated[str, typer.Option(help=MODEL_HELP)],
    joint: Annotated[str | None, typer.Option(help="joint of a bag that holds several")] = None,
    set_: SetOption = None,
    fix: FixOption = None,
    free: FreeOption = None,
    map_: MapOption = None,
    actuation: ActuationOption = None,
    friction: FrictionOption = None,
    gravity: GravityOption = False,
    kinematic_error: KinematicErrorOption = False,
    estimator: Annotated[str, typer.Option(help="innovations or hpinn (needs torch)")] = "innovations",
    start: Annotated[Seconds, typer.Option(help="leave out what is before, s after the first sample")] = None,
    end: Annotated[Seconds, typer.Option(help="leave out what is after, s after the first sample")] = None,
    validate: Annotated[Path | None, typer.Option(help="recording that the fitted model must predict")] = None,
    plot: Annotated[Path | None, typer.Option(help="save a picture of measurement and prediction")] = None,
    json: Annotated[bool, typer.Option("--json", help="machine-readable result")] = False,
) -> None:
    """Identify the parameters of a joint model, with standard deviations and verdicts.

    Exit code 0: converged; 1: no convergence or a poor fit; 2: bad input.
    """
    held = [text for text in fix or () if "=" in text]
    values = numbers(set_ or (), "--set") | numbers(held, "--fix")
    fixed = {text.partition("=")[0].strip() for text in fix or ()}

    from joint_id_core import estimators, formats, report
    from joint_id_core.estimate import Status

    if plot is not None:
        from joint_id_core.cli.plot import check

        check(plot)
    mapping = pairs(map_ or (), "--map")
    recording = _window(formats.read(file, joint, mapping), start, end)
    drive = actuation or drive_of(model, recording)
    built = build_model(model, drive, friction, gravity, kinematic_error)
    with Progress() as progress:
        estimate = estimators.fit(
            built, recording, values, fixed, freed=set(free or ()), estimator=estimator, progress=progress
        )
    result = report.as_dict(estimate)
    text = report.table(estimate)
    if validate is not None and estimate.predictions is not None:
        from joint_id_core.validation import held_out, held_out_drive

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


def _window(recording: Recording, start: float | None, end: float | None) -> Recording:
    """The part of a recording between two instants given in s after its first sample."""
    if start is None and end is None:
        return recording
    first = recording.time[0] if len(recording) else 0.0
    part = recording.window(first + (start or 0.0), float("inf") if end is None else first + end)
    if not len(part):
        raise JointIdError(
            f"{recording.source}: no sample between --start and --end: it lasts {recording.duration:.6g} s"
        )
    return part
