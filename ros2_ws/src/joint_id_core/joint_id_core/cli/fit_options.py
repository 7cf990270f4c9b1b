"""Options of the commands that fit: data and parameter settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from joint_id_core.assignments import measured_by_name, numbers_by_name, texts_by_name
from joint_id_core.errors import JointIdError
from joint_id_core.estimators import Estimator, ParameterSettings
from joint_id_core.jobs.fit_job import FitJob
from joint_id_core.jobs.robot_file import joints_of_robot

Texts = Optional[list[str]]
MAP_HELP = "channel=column, or a product: torque=gtau*vir; torque=tau_#: of every joint; of a bag channel=topic.field"
FileArgument = Annotated[Path, typer.Argument(help="CSV, MAT or bag")]
FilesArgument = Annotated[list[Path], typer.Argument(help="CSV, MAT or bag; several: one fit of all")]
JointOption = Annotated[Optional[str], typer.Option(help="joint of a file that holds several, or name of the only one")]
SetOption = Annotated[
    Texts, typer.Option("--set", help="NAME=VALUE: start value; of a held parameter also NAME=VALUE+-SD")
]
FixOption = Annotated[Texts, typer.Option("--fix", help="NAME, NAME=VALUE or NAME=VALUE+-SD: hold this parameter")]
FreeOption = Annotated[Texts, typer.Option("--free", help="NAME: estimate this parameter that the model holds")]
PRIOR_HELP = (
    "NAME=SD: what is known of a parameter before the data, one standard deviation (relative if it is positive)"
)
PriorOption = Annotated[Texts, typer.Option("--prior", help=PRIOR_HELP)]
MapOption = Annotated[Texts, typer.Option("--map", help=MAP_HELP)]
ROBOT_HELP = "set, fix and free from a parameter file of the identifier, such as config/ur10e.yaml, or by name (ur10e)"
RobotOption = Annotated[Optional[str], typer.Option(help=ROBOT_HELP)]
URDF_HELP = "description of the robot (URDF or MJCF), for the load of all other joints, which the file holds too"
UrdfOption = Annotated[Optional[Path], typer.Option(help=URDF_HELP)]
BASE_GRAVITY_HELP = "gravity in the frame of the base, m/s^2, for --urdf: 9.81,0,0 for a wall (default: 0,0,-9.81)"
BaseGravityOption = Annotated[Optional[str], typer.Option(metavar="X,Y,Z", help=BASE_GRAVITY_HELP)]
STILL_HELP = "joint of the description that stands still, at 0, and was not recorded, as those of a gripper; repeatable"
StillOption = Annotated[Texts, typer.Option("--still", help=STILL_HELP)]
StartOption = Annotated[Optional[float], typer.Option(help="leave out what is before, s after the first sample")]
EndOption = Annotated[Optional[float], typer.Option(help="leave out what is after, s after the first sample")]
JsonOption = Annotated[bool, typer.Option("--json", help="machine-readable result")]


def parameter_settings(set_: Texts, fix: Texts, free: Texts, prior: Texts = None) -> ParameterSettings:
    """Return the parameter settings of --set, --fix, --free and --prior.

    Raises:
        JointIdError: a text that is not NAME=VALUE, a name given twice or in ways that exclude each other, a prior that
            is not above zero.
    """
    for text in free or ():
        if "=" in text:
            name = text.partition("=")[0].strip()
            raise JointIdError(f"--free {text}: give the name alone, and where it starts with --set {name}=VALUE")
    fixed = fix or []
    values, deviations = measured_by_name(set_ or (), "--set")
    held_values, held_deviations = measured_by_name([t for t in fixed if "=" in t], "--fix")
    held = [text.partition("=")[0].strip() for text in fixed]
    for name in held:
        if name in (free or ()):
            raise JointIdError(f"--fix {name} and --free {name} exclude each other: give one of them")
        if name in held_values and name in values:
            raise JointIdError(f"--fix {name} and --set {name} both give a value: give one of them")
    priors = numbers_by_name(prior or (), "--prior")
    return ParameterSettings(values | held_values, held, free or (), priors, deviations | held_deviations)


@dataclass(frozen=True)
class CompareOptions:
    """How a recording is read and what is known of the joint, for all commands that fit."""

    set_: SetOption = None
    fix: FixOption = None
    free: FreeOption = None
    map_: MapOption = None
    robot: RobotOption = None
    start: StartOption = None
    end: EndOption = None

    @cached_property
    def settings(self) -> ParameterSettings:
        """The parameter settings; see `parameter_settings`."""
        return parameter_settings(self.set_, self.fix, self.free)

    @cached_property
    def mapping(self) -> dict[str, str]:
        """The mapping of channels.

        Raises:
            JointIdError: a text that is not CHANNEL=COLUMN, or a channel given twice.
        """
        return texts_by_name(self.map_ or (), "--map")

    @property
    def given(self) -> dict[str, Any]:
        """All options by their names on the command line, without --."""
        return {f.name.rstrip("_"): getattr(self, f.name) for f in fields(self)}


@dataclass(frozen=True)
class FitOptions(CompareOptions):
    """The same for commands that fit one model, which may know more of the joint and of its arm."""

    prior: PriorOption = None
    urdf: UrdfOption = None
    base_gravity: BaseGravityOption = None
    still: StillOption = None

    @cached_property
    def settings(self) -> ParameterSettings:
        """The parameter settings; see `parameter_settings`."""
        return parameter_settings(self.set_, self.fix, self.free, self.prior)

    @property
    def inputs(self) -> list[Path | None]:
        """Files that they name."""
        return [self.urdf, Path(self.robot) if self.robot else None]

    def job(
        self, files: Sequence[Path], joint: str | None, model_options: Mapping[str, Any], estimator: Estimator
    ) -> FitJob:
        """Return the fit of files.

        Raises:
            JointIdError: the file of the robot is of no use, for any joint.
        """
        if self.robot is not None:
            joints_of_robot(self.robot)
        return FitJob(
            files, joint, self.mapping, self.start, self.end, model_options, self.settings, estimator, self.robot,
            self.urdf, self.base_gravity, self.still or (),
        )  # fmt: skip
