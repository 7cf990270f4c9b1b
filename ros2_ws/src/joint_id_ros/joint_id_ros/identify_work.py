"""What the node `identify` computes in processes of their own: the plan of a motion, and the fit of its recording."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rclpy.serialization import serialize_message

from joint_id_core import formats
from joint_id_core.cli.fit_job import FitJob
from joint_id_core.cli.fit_options import parameter_settings
from joint_id_core.cli.report import fitted
from joint_id_core.design.design import Design
from joint_id_core.design.files import read_trajectory, write
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Innovations
from joint_id_core.models.options import ModelOptions
from joint_id_core.pages.contents import Contents
from joint_id_core.pages.joints import report_of_joints
from joint_id_core.pages.report import report
from joint_id_core.results.estimate import Estimate
from joint_id_core.text_file import write_text
from joint_id_ros.child_process import Tell
from joint_id_ros.trajectories import to_message

Fitted = Mapping[str, Estimate | str]  # by joint the estimate, or why there is none


@dataclass(frozen=True)
class Request:
    """What is to be identified, as of the goal and the parameters of the node; "" and () where nothing is given."""

    joints: tuple[str, ...]
    model: str
    set: tuple[str, ...]
    trajectory: str
    duration: float
    robot: str
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


@dataclass(frozen=True)
class Plan:
    """A motion with what it is to show, and the bytes of its JointTrajectory, so that sending it takes no time."""

    design: Design
    message: bytes


def plan(tell: Tell, request: Request, file: Path) -> Plan:
    """Return the motion of a request, and write its trajectory to a file.

    Raises:
        JointIdError: it cannot be read or planned, or it does not move a joint that is to be identified.
    """
    request.job(file, "", None, None)  # wrong words are said before anything moves
    if not request.trajectory:
        raise JointIdError("no motion was given: write one with joint-id design, and give its file as trajectory")
    tell(0.0, f"reading {request.trajectory}")
    trajectory = read_trajectory(request.trajectory)
    if missing := [joint for joint in request.joints if joint not in trajectory.names]:
        raise JointIdError(
            f"{request.trajectory} does not move {', '.join(missing)}: it moves {', '.join(trajectory.names)}"
        )
    write(trajectory, file)
    return Plan(Design(trajectory, ()), serialize_message(to_message(trajectory)))


def fit(
    tell: Tell, request: Request, bag: Path, joints: Sequence[str], span: tuple[float, float] | None, page: Path
) -> Fitted:
    """Fit the joints of a recording one after the other, and write a page about them.

    Args:
        tell: called with the progress.
        request: what is to be identified.
        bag: the recording.
        joints: that are fitted.
        span: first and last instant that is fitted, s since the epoch; None for all.
        page: file to write.
    """
    found: dict[str, Contents | str] = {}
    for k, joint in enumerate(joints):
        tell(k / len(joints), f"fitting {joint}")
        try:
            start, end = None, None
            if span is not None:
                recording = formats.read(bag, joint)
                first = recording.origin + float(recording.time[0])
                start, end = (round(max(0.0, instant - first), 3) for instant in span)
            job = request.job(bag, joint, start, end)
            found[joint] = replace(fitted(job, lambda _: None), command=request.command(job))
        except JointIdError as error:
            found[joint] = str(error)
    tell(1.0, "writing the report")
    (first_found,) = list(found.values())[:1]
    alone = len(found) == 1 and not isinstance(first_found, str)
    write_text(page, report(first_found) if alone else report_of_joints(found, bag.name), "the report")  # type: ignore[arg-type]
    return {
        joint: one if isinstance(one, str) else replace(one.estimate, predictions=None) for joint, one in found.items()
    }


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
