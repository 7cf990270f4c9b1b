"""`joint-id fit`: identify a model from one or several recordings."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from joint_id_core.cli.design_hint import design_hint, motion_hint
from joint_id_core.cli.fit_options import CompareOptions, FilesArgument, FitOptions, JsonOption
from joint_id_core.cli.group import BAD_INPUT, complain
from joint_id_core.cli.joints import at_once, joints_json, joints_table
from joint_id_core.cli.options import completed, with_group, with_options
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.cli.outputs import require_apart, require_different, require_unseen
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ESTIMATORS, Innovations
from joint_id_core.jobs.cores import run_all
from joint_id_core.jobs.fit_job import ALL, FitJob, Result
from joint_id_core.models.options import ModelOptions
from joint_id_core.text_file import require_writable

if TYPE_CHECKING:
    from joint_id_core.estimators.together.fit import Together
    from joint_id_core.jobs.given import Given
    from joint_id_core.results.estimate import Estimate

SHOWN = (
    "cell",
    "substeps",
    "band_hz",
    "lag_s",
    "instruments",
    "epochs",
    "learning_rate",
)  # of the options of the estimators
JOINT_HELP = f"joint of a file that holds several, or name of the only one; {ALL}: each, on all cores, a row a joint"


@with_options("model_options", (ModelOptions,), no_default=("model",))
@with_options("estimator_options", tuple(ESTIMATORS.values()), only=SHOWN)
@with_group("options", FitOptions)
def fit(
    files: FilesArgument,
    options: FitOptions,
    model_options: dict[str, Any],
    estimator_options: dict[str, Any],
    joint: Annotated[Optional[str], typer.Option(help=JOINT_HELP)] = None,
    estimator: Annotated[
        str, typer.Option(help=f"{', '.join(ESTIMATORS)} (needs torch)", autocompletion=completed(tuple(ESTIMATORS)))
    ] = "innovations",
    validate: Annotated[Optional[Path], typer.Option(help="recording that the fitted model must predict")] = None,
    plot: Annotated[
        Optional[Path], typer.Option(help="save a picture of measurement and prediction", readable=False)
    ] = None,
    save: Annotated[Optional[Path], typer.Option(help="save the estimate as JSON", readable=False)] = None,
    json: JsonOption = False,
) -> None:
    """Identify the parameters of a joint model, with standard deviations and verdicts.

    Several files are recordings of the same joint: common physics; own start, noise and offsets. Without --model, the
    models that the signals allow are tried, and every joint of a file is fitted.

    Exit code 0: converged; 1: no convergence or a poor fit; 2: bad input.
    """
    from joint_id_core import estimators, formats

    solver = estimators.build(estimator, **estimator_options)
    ModelOptions(**model_options)  # wrong values are said first
    require_different(files)
    require_unseen(validate, files)
    job = options.job(files, joint, model_options, solver).chosen()
    joint = job.joint
    for option, path in (("--validate", validate), ("--plot", plot), ("--save", save)):
        if joint == ALL and path is not None:
            raise JointIdError(f"{option} is for one joint: name it (--joint NAME), or leave {option} out")
    require_apart({"--plot": plot, "--save": save}, [*files, validate, *options.inputs])
    if save is not None:
        require_writable(save, "the estimate")
    if plot is not None:
        if len(files) > 1:
            raise JointIdError("--plot shows one recording: fit one file, or leave --plot out")
        from joint_id_core.results.plot import require_writable as require_picture

        require_picture(plot)
    if joint == ALL:
        _fit_all(job, json)
        return
    given = job.given(validate)
    with Progress() as progress:
        found = job.run(given, progress)
    together, estimate = found.together, found.estimate
    result, text = _result(together), str(together if len(files) > 1 else estimate)
    if found.why:
        name = None if solver.name == Innovations.name else solver.name
        repeated = {**options.given, "joint": joint, "estimator": name, **estimator_options}
        text = "\n".join(
            [
                *formats.taken(files[0], joint, options.mapping),
                *found.why,
                "",
                text,
                "",
                *_again(files, found, repeated),
            ]
        )
    unpredicted = False
    if given.other is not None and estimate.nrmse:
        try:
            result["validation"], said = _validated(found, given)
        except JointIdError as error:  # the fit is not lost with it
            unpredicted, said = True, f"not predicted: {error}"
        text += f"\nheld out, {validate}: {said}"
    if command := design_hint(estimate, found.job):
        result["design"] = command
    if command := motion_hint(estimate, found.job):
        text += f"\na motion that shows more: {command}"
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
        raise typer.Exit(_exit_code([estimate]))
    if unpredicted:
        complain(f"{validate} could not be predicted, see above")
        raise typer.Exit(BAD_INPUT)


def _validated(found: Result, given: Given) -> tuple[list[dict[str, Any]], str]:
    """Return how the fit predicts the recording to validate with: rows, and in words.

    Raises:
        JointIdError: it is of no use.
    """
    from joint_id_core.estimators.shared.data_check import concerning
    from joint_id_core.validation.prediction import held_out, held_out_drive

    estimate, other = found.estimate, given.other
    assert other is not None
    model = found.job.built(given.recordings[0])
    for finding in concerning(model, other):
        if finding.fatal:
            raise JointIdError(finding.text)
        complain(f"{other.source}: {finding.text}")
    other = found.together.as_fitted(other)
    nrmse = held_out(model, other, estimate)
    rows: list[dict[str, Any]] = [{"signal": name, "nrmse": value} for name, value in nrmse.items()]
    said = ", ".join(f"{name} nrmse {v:.3g}" for name, v in nrmse.items())
    explained = held_out_drive(model, other, estimate)
    if explained is not None:
        rows.append({"signal": explained[0], "r_squared": explained[1]})
        said += f", {explained[0]} R^2 {explained[1]:.4f}"
        if explained[1] < 0.0:
            complain(
                f"{other.source}: its {explained[0]} is predicted worse than by its mean: the fit does not hold there"
            )
    return rows, said


def _again(files: list[Path], found: Result, options: Mapping[str, Any]) -> list[str]:
    """Return what to do next, as commands that can be pasted: the same fit, and one more."""
    if found.estimate.status.unusable:
        return []  # the message says what to do before
    words = _words("fit", files, {**found.job.model_options, **options})
    same = shlex.join(words)
    if found.estimate.converged:
        keep = [f"the same, and keep it: {same} --save estimate.json"]
        if len(files) > 1 or any(options.get(name) is not None for name in SHOWN):
            return keep  # a report takes one file, and no option of an estimator
        return [*keep, f"a page to look at: {shlex.join(['joint-id', 'report', *words[2:]])}"]
    shared = [*(f.name.rstrip("_") for f in fields(CompareOptions)), "joint"]
    others = _words("compare", files[:1], {name: options.get(name) for name in shared})
    found_again = [f"the same: {same}", f"other models: {shlex.join(others)}"]
    if any(text.startswith("harmonic_drive was tried") for text in found.why):
        gear = _words("fit", files, {"model": "motor_side", **options})
        found_again.append(f"the gear by itself, whatever moves the link: {shlex.join(gear)}")
    return found_again


def _words(command: str, files: list[Path], options: Mapping[str, Any]) -> list[str]:
    """Return the words of a command with options by name; those that are None are left out."""
    words = ["joint-id", command, *map(str, files)]
    for name, given in options.items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(given, bool):
            words += [option] if given else []
            continue
        for text in given if isinstance(given, list) else [given]:
            words += [] if text is None else [option, str(text)]
    return words


def _result(together: Together) -> dict[str, Any]:
    """Return what `--json` prints: the estimate; of several recordings, also what each says by itself."""
    result = together.estimate.to_dict()
    if len(together.alone) > 1:
        result["recordings"] = [
            {"source": one.source, "status": one.status.value, "message": one.message, "apart": apart}
            for one, apart in zip(together.alone, together.apart, strict=True)
        ]
    return result


def _fit_all(job: FitJob, json: bool) -> None:
    """Fit every joint of the files, and print a row a joint."""
    from joint_id_core import formats

    with Progress() as progress:
        results = run_all(job.of_every_joint(), progress)
    if json:
        print_json(joints_json(results))
    else:
        taken = formats.taken(job.files[0], None, job.mapping)
        print("\n".join([*taken, *([""] if taken else []), joints_table(results)]))
        if job.urdf is None and (advice := at_once(job.files, job.mapping)):
            print(advice)
    estimates = [r.estimate for r in results.values() if not isinstance(r, str)]
    bad = [joint for joint, r in results.items() if isinstance(r, str) or not r.estimate.converged]
    if bad:
        complain(f"no good estimate of {', '.join(bad)}")
        raise typer.Exit(_exit_code(estimates))


def _exit_code(estimates: list[Estimate]) -> int:
    """Return the code of estimates of which some are not good: bad input if none could be made."""
    return BAD_INPUT if all(estimate.status.unusable for estimate in estimates) else 1
