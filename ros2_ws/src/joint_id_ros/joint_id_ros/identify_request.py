"""What the node `identify` is asked for."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from joint_id_core.cli.fit_options import parameter_settings
from joint_id_core.estimators import Innovations
from joint_id_core.jobs.fit_job import FitJob
from joint_id_core.models.options import ModelOptions


@dataclass(frozen=True)
class Request:
    """What is to be identified, as of the goal and the parameters of the node; "" and () where nothing is given."""

    joints: tuple[str, ...]
    model: str
    set: tuple[str, ...]
    trajectory: str
    duration: float
    robot: str
    limits: str
    reach: float
    urdf: str

    def job(self, bag: Path, joint: str, start: float | None, end: float | None) -> FitJob:
        """Return the fit of one joint of a recording.

        Raises:
            JointIdError: an unknown model, or a text of `set` of another form.
        """
        options = {"model": self.model} if self.model else {}
        if self.model:
            ModelOptions(self.model)  # says what there is
        settings = parameter_settings(list(self.set), None, None)
        urdf = Path(self.urdf) if self.urdf else None
        return FitJob([bag], joint, {}, start, end, options, settings, Innovations(), self.robot or None, urdf)

    def command(self, job: FitJob) -> str:
        """Return the command that makes the report of one joint again."""
        given = {"--joint": job.joint, "--model": self.model, "--robot": self.robot, "--urdf": self.urdf}
        given |= {"--start": _text(job.start), "--end": _text(job.end)}
        words = [word for name, value in given.items() if value for word in (name, value)]
        words += [word for text in self.set for word in ("--set", text)]
        return shlex.join(["joint-id", "report", str(job.files[0]), *words])


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
