"""`joint-id many-starts` and `joint-id bootstrap`: is a fit the best one, and how far does it scatter?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from joint_id_core.cli.fit_options import FileArgument, FitOptions, JointOption, JsonOption
from joint_id_core.cli.options import with_group, with_options
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations, ParameterSettings
from joint_id_core.models.options import ModelOptions

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording
    from joint_id_core.models import Model

DEVICE_HELP = "cpu, or cuda: torch on a GPU"
SeedOption = Annotated[int, typer.Option(min=0, help="of the random draws")]
DeviceOption = Annotated[str, typer.Option(help=DEVICE_HELP)]


@with_options("model_options", (ModelOptions,), no_default=("model",))
@with_group("options", FitOptions)
def many_starts(
    file: FileArgument,
    options: FitOptions,
    model_options: dict[str, Any],
    starts: Annotated[int, typer.Option(min=1, help="fits from random start values")] = 1000,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    joint: JointOption = None,
    json: JsonOption = False,
) -> None:
    """Fit from many random start values: is the minimum that `joint-id fit` finds the best one?

    Exit code 0: no start is better; 1: one is; 2: bad input.
    """
    from joint_id_core.estimators.many.starts import many_starts as run

    model, recording, settings = _read(file, joint, options, model_options)
    with Progress() as progress:
        found = run(model, recording, settings, starts, device, seed, progress=progress)
    print_json(found.to_dict()) if json else print(found)
    if not found.engine_is_best:
        raise typer.Exit(1)


@with_options("model_options", (ModelOptions,), no_default=("model",))
@with_group("options", FitOptions)
def bootstrap(
    file: FileArgument,
    options: FitOptions,
    model_options: dict[str, Any],
    draws: Annotated[int, typer.Option(help="fits with random weights of the blocks")] = 200,
    block: Annotated[float, typer.Option(help="length of the blocks in s")] = 0.05,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    joint: JointOption = None,
    json: JsonOption = False,
) -> None:
    """Fit again and again with random weights of the record's parts: do the standard deviations hold? Needs torch.

    Exit code 0: done; 2: bad input.
    """
    from joint_id_core.estimators.many.bootstrap import bootstrap as run

    model, recording, settings = _read(file, joint, options, model_options)
    with Progress() as progress:
        found = run(model, recording, settings, draws, block, device, seed, progress=progress)
    print_json(found.to_dict()) if json else print(found)


def _read(
    file: Path, joint: str | None, options: FitOptions, model_options: dict[str, Any]
) -> tuple[Model, Recording, ParameterSettings]:
    """Return model, recording and settings.

    Raises:
        JointIdError: no model is named.
    """
    if "model" not in model_options:
        raise JointIdError("name the model (--model), such as the one that `joint-id fit` found")
    job = options.job([file], joint, model_options, Innovations())
    recording = job.given().recordings[0]
    model = job.built(recording)
    return model, recording, job.settings_for(model)
