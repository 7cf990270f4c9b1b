"""`joint-id report`: a page about a fit, in one file."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from joint_id_core.cli.design_hint import motion_hint
from joint_id_core.cli.fit_options import FitOptions, JointOption
from joint_id_core.cli.group import BAD_INPUT, complain
from joint_id_core.cli.info import doubts
from joint_id_core.cli.joints import remarks
from joint_id_core.cli.options import completed, with_group, with_options
from joint_id_core.cli.output import Progress
from joint_id_core.cli.outputs import require_apart
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ESTIMATORS
from joint_id_core.jobs.cores import of_all
from joint_id_core.jobs.fit_job import ALL, FitJob
from joint_id_core.models.options import ModelOptions
from joint_id_core.text_file import require_writable, write_text

if TYPE_CHECKING:
    from joint_id_core.pages.contents import Contents


@with_options("model_options", (ModelOptions,), no_default=("model",))
@with_group("options", FitOptions)
def report(
    source: Annotated[Path, typer.Argument(help="CSV, MAT or bag, which is fitted; or an estimate, from fit --save")],
    options: FitOptions,
    model_options: dict[str, Any],
    out: Annotated[Path, typer.Option("--out", "-o", help="file to write", readable=False)] = Path("report.html"),
    joint: JointOption = None,
    estimator: Annotated[
        str, typer.Option(help=", ".join(ESTIMATORS), autocompletion=completed(tuple(ESTIMATORS)))
    ] = "innovations",
    against: Annotated[Optional[Path], typer.Option(help="earlier estimate to compare with, from fit --save")] = None,
) -> None:
    """Write a page about a recording and its fit: one file of HTML that needs no network.

    Of a file with several joints, the page shows all, unless --joint or --model is given. Of an estimate alone, it
    has no pictures: they need the recording.

    Exit code 0: converged; 1: no convergence or a poor fit, which has its page, too; 2: bad input.
    """
    from joint_id_core import estimators
    from joint_id_core.pages.contents import Contents
    from joint_id_core.pages.report import report as page
    from joint_id_core.results.estimate import Estimate

    require_apart({"--out": out}, [source, against, *options.inputs])
    _require_page(out)
    earlier = Estimate.load(against) if against is not None else None
    command = shlex.join(["joint-id", *sys.argv[1:]])
    if source.suffix.lower() == ".json":
        if model_options or joint or any(options.given.values()):
            raise JointIdError(
                f"{source} is an estimate, which is not fitted again: leave out all options but --against"
            )
        contents = Contents(Estimate.load(source), command=command, earlier=earlier)
    else:
        job = options.job([source], joint, model_options, estimators.build(estimator)).chosen()
        if job.joint == ALL:
            if earlier is not None:
                raise JointIdError("--against is for one joint: name it (--joint NAME), or leave --against out")
            _of_all(job, out)
            return
        with Progress() as progress:
            contents = replace(fitted(job, progress), command=command, earlier=earlier)
    text = page(contents)
    write_text(out, text, "the report")
    estimate = contents.estimate
    print(f"{out}: {estimate.model}, {estimate.status.value}, {out.stat().st_size / 1e3:.0f} kB")
    if not estimate.converged:
        complain(f"{estimate.status.value}: {estimate.message}")
        raise typer.Exit(1)


def fitted(job: FitJob, progress: Callable[[str], None]) -> Contents:
    """Fit a recording, and find what a report shows beside the estimate."""
    from joint_id_core.pages.contents import Contents, held_out, windows

    given = job.given()
    recordings = given.recordings
    found = job.run(given, progress)
    model = found.job.built(recordings[0])
    rest = (model, recordings[0], found.job.settings_for(model), job.estimator)
    progress("fitting the first part, to predict the rest")
    predicted = held_out(*rest)
    progress("following the motion with the online identifier")
    followed = windows(*rest)
    rows = doubts(recordings[0], recordings)
    suspects = [(name, k) for row in rows for name in row["channels"][:1] for k in row["samples"]]
    return Contents(
        found.estimate, recordings[0], "", found.why, [row["text"] for row in rows], suspects, followed, predicted,
        motion=motion_hint(found.estimate, found.job),
    )  # fmt: skip


def _of_all(job: FitJob, out: Path) -> None:
    """Write one page about all joints of a file."""
    from joint_id_core.pages.joints import report_of_joints
    from joint_id_core.results.report import beside_others

    with Progress() as progress:
        found = of_all(job.of_every_joint(), _one, progress)
    words = [word for word in sys.argv[1:] if word not in ("--joint", ALL, f"--joint={ALL}")]
    for joint, one in found.items():
        if not isinstance(one, str):
            found[joint] = replace(one, command=shlex.join(["joint-id", *words, "--joint", joint]))
    write_text(out, report_of_joints(found, job.files[0].name), "the report")
    print(f"{out}: {len(found)} joints, {out.stat().st_size / 1e3:.0f} kB")
    told = {
        joint: one if isinstance(one, str) else beside_others(one.estimate, one.estimate.message)
        for joint, one in found.items()
    }
    bad = [joint for joint, one in found.items() if isinstance(one, str) or not one.estimate.converged]
    if bad:
        print(*remarks({joint: told[joint] for joint in bad}), sep="\n")
        complain(f"no good estimate of {', '.join(bad)}")
        raise typer.Exit(1 if any(not isinstance(one, str) for one in found.values()) else BAD_INPUT)


def _one(job: FitJob) -> tuple[str, Contents | str]:
    """Return a joint and what its report is made of, or what was wrong with it."""
    assert job.joint is not None
    try:
        return job.joint, fitted(job, lambda _: None)
    except JointIdError as error:
        return job.joint, str(error)


def _require_page(path: Path) -> None:
    """Check, before a long fit, that the page can be written.

    Raises:
        JointIdError: it cannot, or its name is that of another kind of file.
    """
    if path.suffix.lower() not in ("", ".html", ".htm"):
        raise JointIdError(f"{path}: the report is a page of HTML, which a browser can print: end its name in .html")
    require_writable(path, "the report")
