"""What `joint-id fit` proposes for parameters that a motion does not show: a command that designs another motion."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from joint_id_core.errors import JointIdError
from joint_id_core.models import build

if TYPE_CHECKING:
    from joint_id_core.jobs.fit_job import FitJob
    from joint_id_core.results.estimate import Estimate

LIMITS = "joint_limits.yaml"  # stands for the user's file


def design_hint(estimate: Estimate, job: FitJob) -> str:
    """Return a command that can be pasted, empty if every parameter is shown or no motion can be designed.

    It holds what the fit found and what it was told, so that the motion is designed for this joint.
    """
    from joint_id_core.results.verdict import Verdict  # loads NumPy

    model = build(estimate.model, **estimate.model_options)
    unseen = [
        p.name
        for p in estimate.parameters
        if p.verdict is Verdict.NOT_EXCITED and not model.parameter(p.name).of_recording
    ]
    if not unseen or model.torque_drive is None:
        return ""
    words = ["joint-id", "design", "--joint", estimate.joint or job.joint or "joint", "--model", estimate.model]
    defaults = build(estimate.model, actuation=model.torque_drive)
    for name, value in estimate.model_options.items():
        if name == "actuation" or value != getattr(defaults, name):
            words += [f"--{name.replace('_', '-')}", *([] if isinstance(value, bool) else [str(value)])]
    words += _robot(job.robot)
    for p in estimate.parameters:
        told = p.verdict is Verdict.FIXED and p.value != model.parameter(p.name).nominal and job.robot is None
        if told or p.verdict is Verdict.ESTIMATED:
            words += ["--set", f"{p.name}={p.value:.4g}"]
    words += [word for name in job.settings.fixed for word in ("--fix", name)]
    words += [word for name in job.settings.freed for word in ("--free", name)]
    words += [word for name, sd in job.settings.priors.items() for word in ("--prior", f"{name}={sd:g}")]
    return shlex.join([*words, "--for", ",".join(unseen), "--out", "designed.csv"])


def motion_hint(estimate: Estimate, job: FitJob) -> str:
    """Return the same where another motion helps; empty where the recording itself cannot be used."""
    from joint_id_core.results.status import Status  # loads NumPy

    no_fault_of_it = (Status.BAD_DATA, Status.TOO_SHORT, Status.MISSING_SIGNAL)
    return "" if estimate.status in no_fault_of_it else design_hint(estimate, job)


def _robot(robot: str | None) -> list[str]:
    """Return the options that say where the limits are: those of a robot that is known, else the user's file."""
    from joint_id_core.design.limit_files import published

    if robot is None:
        return ["--limits", LIMITS]
    try:
        published(Path(robot).stem)
    except JointIdError:
        return ["--robot", robot, "--limits", LIMITS]
    return ["--robot", robot]
