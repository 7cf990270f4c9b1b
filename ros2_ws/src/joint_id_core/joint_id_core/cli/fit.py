"""`joint-id fit`: identify a model from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from joint_id_core.assignments import texts_by_name
from joint_id_core.cli.fit_options import (
    EndOption,
    FileArgument,
    FixOption,
    FreeOption,
    JointOption,
    JsonOption,
    MapOption,
    PriorOption,
    SetOption,
    StartOption,
    parameter_settings,
    window,
)
from joint_id_core.cli.group import BAD_INPUT, complain
from joint_id_core.cli.options import with_options
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.estimators import ESTIMATORS
from joint_id_core.models.options import ModelOptions

SHOWN = ("cell", "substeps", "band_hz", "lag_s", "epochs", "learning_rate")  # of the options of the estimators


@with_options("model_options", (ModelOptions,), required=("model",))
@with_options("estimator_options", tuple(ESTIMATORS.values()), only=SHOWN)
def fit(
    file: FileArgument,
    model_options: dict[str, Any],
    estimator_options: dict[str, Any],
    joint: JointOption = None,
    set_: SetOption = None,
    fix: FixOption = None,
    free: FreeOption = None,
    map_: MapOption = None,
    estimator: Annotated[str, typer.Option(help=f"{', '.join(ESTIMATORS)} (needs torch)")] = "innovations",
    prior: PriorOption = None,
    start: StartOption = None,
    end: EndOption = None,
    validate: Annotated[Optional[Path], typer.Option(help="recording that the fitted model must predict")] = None,
    plot: Annotated[Optional[Path], typer.Option(help="save a picture of measurement and prediction")] = None,
    save: Annotated[Optional[Path], typer.Option(help="save the estimate as JSON")] = None,
    json: JsonOption = False,
) -> None:
    """Identify the parameters of a joint model, with standard deviations and verdicts.

    Exit code 0: converged; 1: no convergence or a poor fit; 2: bad input.
    """
    settings = parameter_settings(set_, fix, free, prior)

    from joint_id_core import estimators, formats

    chosen = ModelOptions(**model_options)
    solver = estimators.build(estimator, **estimator_options)
    if plot is not None:
        from joint_id_core.results.plot import require_writable

        require_writable(plot)
    mapping = texts_by_name(map_ or (), "--map")
    recording = window(formats.read(file, joint, mapping), start, end)
    other = formats.read(validate, joint, mapping) if validate is not None else None
    built = chosen.build(chosen.drive_in(recording))
    with Progress() as progress:
        estimate = estimators.fit(built, recording, settings, solver, progress)
    result, text = estimate.to_dict(), str(estimate)
    if other is not None and estimate.predictions is not None:
        from joint_id_core.validation.prediction import held_out, held_out_drive

        nrmse = held_out(built, other, estimate)
        result["validation"] = [{"signal": name, "nrmse": value} for name, value in nrmse.items()]
        text += f"\nheld out, {validate}: " + ", ".join(f"{name} nrmse {v:.3g}" for name, v in nrmse.items())
        explained = held_out_drive(built, other, estimate)
        if explained is not None:
            result["validation"].append({"signal": explained[0], "r_squared": explained[1]})
            text += f", {explained[0]} R^2 {explained[1]:.4f}"
    if json:
        print_json(result)
    else:
        print(text)
    if save is not None:
        estimate.save(save)
    if plot is not None and estimate.predictions is not None:
        estimate.plot(plot)
    if not estimate.converged:
        complain(f"{estimate.status.value}: {estimate.message}")
        raise typer.Exit(BAD_INPUT if estimate.status.unusable else 1)
