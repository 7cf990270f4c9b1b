"""Options of the commands about a whole arm: its drives, its base, and which part of the recordings is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.arm.gains import NAMES, Drive, Gains, gains_of
from joint_id_core.assignments import texts_by_name
from joint_id_core.cli.fit_options import BASE_GRAVITY_HELP, EndOption, MapOption, StartOption, StillOption, Texts
from joint_id_core.errors import JointIdError
from joint_id_core.jobs.given import Part, described, joints_of, names_in
from joint_id_core.jobs.robot_file import robot_settings
from joint_id_core.models.per_joint import parse

if TYPE_CHECKING:
    from joint_id_core.arm.description import Description
    from joint_id_core.data.recording import Recording

SET_HELP = "JOINT.k_t=VALUE, JOINT.N=VALUE, or k_t=VALUE for all"
ROBOT_HELP = "torque constants and ratios from a parameter file of the identifier, or by name"
UrdfArgument = Annotated[Path, typer.Argument(help="description of the robot (URDF or MJCF)")]


@dataclass(frozen=True)
class ArmOptions:
    """What the recordings of an arm are of."""

    set_: Annotated[Texts, typer.Option("--set", help=SET_HELP)] = None
    robot: Annotated[Optional[str], typer.Option(help=ROBOT_HELP)] = None
    map_: MapOption = None
    base_gravity: Annotated[Optional[str], typer.Option(metavar="X,Y,Z", help=BASE_GRAVITY_HELP)] = None
    still: StillOption = None
    start: StartOption = None
    end: EndOption = None

    @property
    def inputs(self) -> list[Path | None]:
        """Files that they name."""
        return [Path(self.robot) if self.robot else None]

    def description(self, urdf: Path) -> Description:
        """Read the description of the robot, with its base as it stands."""
        return described(urdf, self.base_gravity, self.still or ())

    def gains(self, joints: Sequence[str]) -> tuple[Gains, str]:
        """Return the torques of all drives, and how far their torque constants are known."""
        return gains_of(joints, [parse(text, "set") for text in self.set_ or ()], partial(_drive, self.robot))

    @cached_property
    def part(self) -> Part:
        """The part of a recording that is fitted."""
        return Part(texts_by_name(self.map_ or (), "--map"), self.start, self.end)

    @property
    def whole(self) -> Part:
        """All of a recording."""
        return Part(self.part.mapping, None, None)


def read(file: Path, part: Part, description: Description) -> dict[str, Recording]:
    """Read all joints of the robot that a file holds.

    Raises:
        JointIdError: it holds one joint without a name, or joints of other names in place of some.
    """
    found = names_in(description.joints, joints_of(file, part.mapping))
    names, known = tuple(found.values()), (*description.joints, *description.fixed)
    missing = [name for name in description.joints if name not in names]
    others = [name for name in names if name not in known]
    if missing and others:
        raise JointIdError(
            f"{file}: no recording of {', '.join(missing)}, which {description.source} moves; it holds "
            f"{', '.join(others)}, which the description has not: name those that were not recorded and stand still "
            "(--still), if as many are left, numbered joints are these in their order; else give the same joints the "
            "same names in a copy of the description, or record all"
        )
    there = {own: name for own, name in found.items() if name in known}
    return {there[own]: replace(one, joint=there[own]) for own, one in part.read_joints(file, there).items()}


def _drive(robot: str | None, joint: str) -> Drive:
    """Return what a parameter file of the identifier says of the drive of a joint."""
    if robot is None:
        return Drive()
    known = robot_settings(robot, joint, NAMES)
    return Drive(known.values, known.deviations)
