"""`joint-id compare`: which model describes a recording best."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.cli.fit_options import CompareOptions, FileArgument, JointOption, JsonOption, Texts
from joint_id_core.cli.group import BAD_INPUT, complain
from joint_id_core.cli.options import with_group
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.cli.outputs import require_unseen
from joint_id_core.comparison.model_text import GRAMMAR
from joint_id_core.errors import JointIdError
from joint_id_core.jobs.given import window
from joint_id_core.jobs.robot_file import robot_settings

if TYPE_CHECKING:
    from joint_id_core.comparison.trial import Trial
    from joint_id_core.estimators.shared.settings import ParameterSettings

MODELS_HELP = (
    f"{GRAMMAR}; repeat it or separate with commas (default: every law of the models that the recording can tell of, "
    "with gravity where the motion shows it; a single model without a law: every law of it)"
)


@with_group("options", CompareOptions)
def compare(
    file: FileArgument,
    options: CompareOptions,
    models: Annotated[Texts, typer.Option("--models", help=MODELS_HELP)] = None,
    joint: JointOption = None,
    validate: Annotated[Optional[Path], typer.Option(help="recording to predict, instead of the last part")] = None,
    held_out: Annotated[Optional[float], typer.Option(help="share of the samples to predict (default: 1/3)")] = None,
    json: JsonOption = False,
) -> None:
    """Fit several models to the first part of a recording and rank them by what they predict of the rest.

    Exit code 0: at least one model describes it; 1: none does; 2: bad input.
    """
    if validate is not None and held_out is not None:
        raise JointIdError("--validate and --held-out exclude each other: with --validate all of FILE is fitted")
    require_unseen(validate, [file])
    settings = options.settings
    texts = [text for option in models or () for text in option.split(",")]

    from joint_id_core import formats
    from joint_id_core.comparison import comparing as comparison
    from joint_id_core.comparison.model_text import parse

    recording = window(formats.read(file, joint, options.mapping), options.start, options.end)
    validation = formats.read(validate, joint, options.mapping) if validate is not None else None
    if options.robot is not None:
        known = {n for c in parse(texts, recording) for n in c.model.parameter_names}
        settings = settings.over(robot_settings(options.robot, joint, known))
    share = comparison.HELD_OUT_SHARE if held_out is None else held_out
    with Progress() as progress:
        result = comparison.compare(texts, recording, validation, share, settings, progress)
    best = result.ranking.best
    again = _fit_arguments(best, settings, options) if best else []
    if json:
        print_json(result.to_dict() | {"fit_arguments": again})
    else:
        print(result)
        if best:
            data = [
                ("--joint", joint),
                ("--robot", options.robot),
                *(("--map", text) for text in options.map_ or ()),
                ("--start", options.start),
                ("--end", options.end),
            ]
            said = [word for option, value in data if value is not None for word in (option, str(value))]
            print(f"its parameters: {shlex.join(['joint-id', 'fit', str(file), *again, *said])}")
    if not any(row.trial.estimate.converged for row in result.ranking.rows):
        complain(result.ranking.conclusion)
        raise typer.Exit(BAD_INPUT if all(r.trial.estimate.status.unusable for r in result.ranking.rows) else 1)


def _fit_arguments(trial: Trial, settings: ParameterSettings, options: CompareOptions) -> list[str]:
    """Return the arguments of `joint-id fit` that repeat the fit of this candidate."""
    model, estimate = trial.candidate.model, trial.estimate
    usual = dict(zip(model.parameter_names, settings.of(model).applied_to(model)[0], strict=True))
    lists = {"--set": options.set_ or [], "--fix": options.fix or [], "--free": options.free or []}
    given = {text.partition("=")[0].strip() for texts in lists.values() for text in texts}
    names = [name for name in model.smoothing.values() if name not in given]
    names += [name for name in estimate.free if estimate[name].initial != usual[name]]
    words = list(trial.candidate.arguments)
    for option, texts in lists.items():
        for text in texts:
            name = text.partition("=")[0].strip()
            if name in model.parameter_names and not (option == "--set" and name in names):
                words += [option, text]
    return words + [word for name in names for word in ("--set", f"{name}={estimate[name].initial:.6g}")]
