"""`joint-id batch`: every joint of many recordings, in one table."""

from __future__ import annotations

import hashlib
import json as json_text
from dataclasses import asdict
from pathlib import PurePath
from typing import Annotated, Any, Optional

import typer

from joint_id_core.cli.fit import SHOWN
from joint_id_core.cli.fit_options import FitOptions, JsonOption
from joint_id_core.cli.group import complain
from joint_id_core.cli.options import completed, with_group, with_options
from joint_id_core.cli.output import Progress, print_json
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import ESTIMATORS
from joint_id_core.jobs.given import described
from joint_id_core.jobs.robot_file import path_of
from joint_id_core.models.options import ModelOptions

PATTERN_HELP = (
    "files, folders, addresses (s3://...), or patterns in quotes: 'logs/**/*.mcap'; {robot} and {joint} are names in "
    "it: 'logs/{robot}/*.mcap'"
)
TOLD = 5  # recordings that could not be read or fitted; the table has all
JOBS_HELP = "processes, one thread each (default: one a core)"
DASK_HELP = "address of a Dask scheduler, such as tcp://host:8786, whose workers do the work"


@with_options("model_options", (ModelOptions,), no_default=("model",))
@with_options("estimator_options", tuple(ESTIMATORS.values()), only=SHOWN)
@with_group("options", FitOptions)
def batch(
    recordings: Annotated[list[str], typer.Argument(help=PATTERN_HELP)],
    options: FitOptions,
    model_options: dict[str, Any],
    estimator_options: dict[str, Any],
    output: Annotated[
        str, typer.Option("--output", "-o", help="table (parquet) to write or go on with, or its address")
    ],
    joint: Annotated[Optional[str], typer.Option(help="only this joint")] = None,
    estimator: Annotated[
        str, typer.Option(help=f"{', '.join(ESTIMATORS)} (needs torch)", autocompletion=completed(tuple(ESTIMATORS)))
    ] = "innovations",
    jobs: Annotated[Optional[int], typer.Option(min=1, help=JOBS_HELP)] = None,
    dask: Annotated[Optional[str], typer.Option(metavar="ADDRESS", help=DASK_HELP)] = None,
    retry: Annotated[bool, typer.Option("--retry", help="do again what could not be read or fitted before")] = False,
    json: JsonOption = False,
) -> None:
    """Fit every joint of many recordings into one table, a row each; what is wrong with one is a row, too.

    The same command goes on after it was ended in any way, and takes in new recordings. Without --model, each joint
    gets the richest model that its motion shows.

    Exit code 0: every recording was fitted; 1: some could not be read or fitted, and their rows say why; 2: bad input.
    """
    from joint_id_core import estimators
    from joint_id_core.batch.cluster import on_cluster
    from joint_id_core.batch.recordings import find
    from joint_id_core.batch.run import on_this_computer, run
    from joint_id_core.batch.work import Work

    if jobs is not None and dask is not None:
        raise JointIdError("--jobs and --dask exclude each other: the number of workers is that of the cluster")
    if (ending := PurePath(output).suffix.lower()) not in ("", ".parquet", ".pq"):
        raise JointIdError(f"-o {output}: the table is not {ending} but Parquet: end its name in .parquet")
    solver = estimators.build(estimator, **estimator_options)
    ModelOptions(**model_options)  # wrong values are said first
    job = options.job((), joint, model_options, solver)
    if options.urdf is not None:
        described(options.urdf, options.base_gravity, job.still)  # what is wrong with it is said once
    places = {"robot": None if options.robot is None else path_of(options.robot), "urdf": options.urdf}
    files = {name: (path.name, path.read_bytes()) for name, path in places.items() if path is not None}
    given = options.given | {"joint": joint, "map": options.mapping, "estimator": estimator}
    given |= {name: f"{own} {hashlib.sha256(text).hexdigest()[:16]}" for name, (own, text) in files.items()}
    given |= model_options | estimator_options
    chosen = {name: value for name, value in given.items() if value not in (None, [], {})}
    words = json_text.dumps(chosen, sort_keys=True)
    with Progress() as progress:
        progress("looking for recordings")
        found = find(recordings)
        pool = on_this_computer(jobs) if dask is None else (lambda work, some: on_cluster(work, some, dask))
        done = run(found, Work(job, words, files), output, pool, retry, progress)
    for text in done.said:
        complain(text)
    if json:
        print_json({"output": output, **asdict(done)})
    else:
        counts = ", ".join(f"{count} {status}" for status, count in sorted(done.rows.items()))
        print(
            f"{output}: {_many(sum(done.rows.values()), 'row')} ({counts}); {_many(done.fitted, 'recording')} fitted, "
            f"{done.before} were finished before"
        )
    if done.failed:
        for text in done.failures[:TOLD]:
            complain(text)
        complain(f"{_many(done.failed, 'recording')} could not be read or fitted: see the column message of their rows")
        raise typer.Exit(1)


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
