"""The work of `joint-id fit`: read, build the model, fit; for one joint, or for all joints of a bag on all cores."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from joint_id_core.cli.fit_options import window
from joint_id_core.cli.robot_file import robot_settings
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Estimator, ParameterSettings, fit_several
from joint_id_core.models.options import ModelOptions

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording
    from joint_id_core.estimators.together.fit import Together
    from joint_id_core.models import Model
    from joint_id_core.options import Progress
    from joint_id_core.results.estimate import Estimate

ALL = "all"  # the name that stands for every joint


@dataclass(frozen=True)
class FitJob:
    """What is fitted, and how; the fields are the arguments of the command."""

    files: Sequence[Path]
    joint: str | None
    mapping: Mapping[str, str]
    start: float | None
    end: float | None
    model: ModelOptions
    settings: ParameterSettings
    estimator: Estimator
    robot: str | None = None

    def recordings(self) -> list[Recording]:
        """Read the part of every file that is fitted."""
        from joint_id_core import formats

        return [window(formats.read(file, self.joint, self.mapping), self.start, self.end) for file in self.files]

    def built(self, recording: Recording) -> Model:
        """Return the model, for the drive that a recording has."""
        return self.model.build(self.model.drive_in(recording))

    def settings_for(self, model: Model) -> ParameterSettings:
        """Return the settings of the command, over those of the robot's file."""
        if self.robot is None:
            return self.settings
        return self.settings.over(robot_settings(self.robot, self.joint, model))

    def run(self, recordings: Sequence[Recording] = (), progress: Progress | None = None) -> Together:
        """Fit one joint, from recordings that were read already, or else from the files."""
        recordings = recordings or self.recordings()
        model = self.built(recordings[0])
        return fit_several(model, recordings, self.settings_for(model), self.estimator, progress)

    def of_every_joint(self) -> list[FitJob]:
        """Return one job for every joint that the files hold.

        Raises:
            JointIdError: a file holds one joint without a name.
        """
        from joint_id_core import formats

        names: dict[str, None] = {}
        for file in self.files:
            found = formats.joints(file, self.mapping)
            if not found:
                raise JointIdError(f"{file}: --joint {ALL} needs a bag; this file holds one joint without a name")
            names |= dict.fromkeys(found)
        return [replace(self, joint=name) for name in names]


def _one(job: FitJob) -> tuple[str, Together | str]:
    """Fit one joint; return its name and the result, or what was wrong with it."""
    assert job.joint is not None
    try:
        return job.joint, job.run()
    except JointIdError as error:
        return job.joint, str(error)


def run_all(jobs: Sequence[FitJob]) -> dict[str, Together | str]:
    """Fit several joints on all cores; return by joint the result, or what was wrong with it."""
    workers = min(len(jobs), os.cpu_count() or 1)
    if workers < 2:
        return dict(map(_one, jobs))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        return dict(pool.map(_one, jobs))


def joints_table(results: Mapping[str, Together | str]) -> str:
    """Return a table with a row a joint: status, and the estimated parameters."""
    width = max(len("joint"), *map(len, results)) + 2
    lines = [f"  {'joint':<{width}}{'status':<16}parameters"]
    also = []
    for joint, result in results.items():
        if isinstance(result, str):
            lines.append(f"  {joint:<{width}}{'not fitted':<16}")
            also.append(f"  {joint}: {result}")
            continue
        estimate = result.estimate
        lines.append(f"  {joint:<{width}}{estimate.status.value:<16}{_values(estimate)}")
        if not estimate.converged:
            also.append(f"  {joint}: {estimate.message}")
    return "\n".join([*lines, *([""] if also else []), *also])


def _values(estimate: Estimate) -> str:
    from joint_id_core.results.estimate import Verdict

    known = [p for p in estimate.parameters if p.verdict is Verdict.ESTIMATED]
    return ", ".join(f"{p.name} {p.value:.4g} ± {p.std_dev:.2g} {p.unit}" for p in known) or "-"


def joints_json(results: Mapping[str, Together | str]) -> list[dict[str, Any]]:
    """Return the results as plain JSON types, an entry a joint."""
    return [
        {"joint": joint, "error": result} if isinstance(result, str) else {"joint": joint, **result.estimate.to_dict()}
        for joint, result in results.items()
    ]
