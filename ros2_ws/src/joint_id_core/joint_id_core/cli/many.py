"""`joint-id many-starts` and `joint-id bootstrap`: is a fit the best one, and how far does it scatter?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

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
    RobotOption,
    SetOption,
    StartOption,
    parameter_settings,
)
from joint_id_core.cli.options import with_options
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations
from joint_id_core.jobs.fit_job import FitJob
from joint_id_core.models.options import ModelOptions

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording
    from joint_id_core.models import Model

DEVICE_HELP = "cpu, or cuda: torch on a GPU"
SeedOption = Annotated[int, typer.Option(min=0, help="of the random draws")]
DeviceOption = Annotated[str, typer.Option(help=DEVICE_HELP)]


@with_options("model_options", (ModelOptions,), no_default=("model",))
def many_starts(
    file: FileArgument,
    model_options: dict[str, Any],
    starts: Annotated[int, typer.Option(min=1, help="fits from random start values")] = 1000,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    joint: JointOption = None,
    set_: SetOption = None,
    fix: FixOption = None,
    free: FreeOption = None,
    prior: PriorOption = None,
    map_: MapOption = None,
    robot: RobotOption = None,
    start: StartOption = None,
    end: EndOption = None,
    json: JsonOption = False,
) -> None:
    """Fit from many random start values: is the minimum that `joint-id fit` finds the best one?

    Exit code 0: no start is better; 1: one is; 2: bad input.
    """
    from joint_id_core.estimators.many.starts import many_starts as run

    job = _job(file, joint, map_, start, end, model_options, set_, fix, free, prior, robot)
    model, recording, settings = _read(job)
    with Progress() as progress:
        found = run(model, recording, settings, starts, device, seed, progress=progress)
    print_json(found.to_dict()) if json else print(found)
    if not found.engine_is_best:
        raise typer.Exit(1)


@with_options("model_options", (ModelOptions,), no_default=("model",))
def bootstrap(
    file: FileArgument,
    model_options: dict[str, Any],
    draws: Annotated[int, typer.Option(help="fits with random weights of the blocks")] = 200,
    block: Annotated[float, typer.Option(help="length of the blocks in s")] = 0.05,
    device: DeviceOption = "cpu",
    seed: SeedOption = 0,
    joint: JointOption = None,
    set_: SetOption = None,
    fix: FixOption = None,
    free: FreeOption = None,
    prior: PriorOption = None,
    map_: MapOption = None,
    robot: RobotOption = None,
    start: StartOption = None,
    end: EndOption = None,
    json: JsonOption = False,
) -> None:
    """Fit again and again with random weights of the record's parts: do the standard deviations hold? Needs torch.

    Exit code 0: done; 2: bad input.
    """
    from joint_id_core.estimators.many.bootstrap import bootstrap as run

    job = _job(file, joint, map_, start, end, model_options, set_, fix, free, prior, robot)
    model, recording, settings = _read(job)
    with Progress() as progress:
        found = run(model, recording, settings, draws, block, device, seed, progress=progress)
    print_json(found.to_dict()) if json else print(found)


def _job(
    file: Path, joint: str | None, map_: Optional[list[str]], start: float | None, end: float | None,
    model_options: dict[str, Any], set_: Optional[list[str]], fix: Optional[list[str]], free: Optional[list[str]],
    prior: Optional[list[str]], robot: str | None,
) -> FitJob:  # fmt: skip
    if "model" not in model_options:
        raise JointIdError("name the model (--model), such as the one that `joint-id fit` found")
    mapping = texts_by_name(map_ or (), "--map")
    settings = parameter_settings(set_, fix, free, prior)
    return FitJob([file], joint, mapping, start, end, model_options, settings, Innovations(), robot)


def _read(job: FitJob) -> tuple[Model, Recording, Any]:
    """Return model, recording and settings of a job."""
    recording = job.given().recordings[0]
    model = job.built(recording)
    return model, recording, job.settings_for(model)
