"""`joint-id design --arm robot.urdf`: a motion for a whole arm."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from joint_id_core.cli.motion_options import MotionOptions
from joint_id_core.cli.output import Progress
from joint_id_core.errors import JointIdError
from joint_id_core.jobs.given import described

if TYPE_CHECKING:
    from joint_id_core.arm.description import Description
    from joint_id_core.design.design import Design
    from joint_id_core.design.limits import JointLimits

ArmOption = Annotated[Optional[Path], typer.Option("--arm", help="description (URDF): a motion for the whole arm")]
FloorOption = Annotated[
    Optional[float], typer.Option(help="--arm: height over the base that the origin of no link goes below, m")
]
FitOption = Annotated[
    Optional[Path], typer.Option("--fit", help="--arm: noise and friction of this arm (joint-id arm fit --save)")
]


def design_of_arm(
    urdf: Path, asked: MotionOptions, criterion: str, floor: float | None, fit: Path | None, base_gravity: str | None
) -> Design:
    """Design the motion, write and plot it.

    Raises:
        JointIdError: bad input, see `joint_id_core.design.arm_design.design_arm`.
    """
    from joint_id_core.arm.regressor import Regressor
    from joint_id_core.design import arm_design as designing
    from joint_id_core.design.arm_prior import of_fit, typical
    from joint_id_core.design.files import read_trajectory
    from joint_id_core.design.limits import violations
    from joint_id_core.design.waypoints import read_waypoints

    asked.require_writable([urdf, fit])
    description = described(urdf, base_gravity)
    joints, regressor = description.joints, Regressor(description)
    held = _limits(urdf, asked, description)
    prior = typical(regressor, held) if fit is None else of_fit(fit, joints)
    with Progress() as progress:
        if asked.motion is not None:
            motion = read_trajectory(asked.motion)
            broken = [f"It breaks a limit: {text}." for text in violations(motion, held)]
            found = designing.foreseen(regressor, motion, prior, (prior.told, *broken))
        else:
            asked.require_program(joints, asked.rate)
            progress(f"designing a motion of {len(joints)} joints")
            home = None if asked.home is None else _numbers(asked.home, joints)
            reach = designing.REACH if asked.reach is None else asked.reach
            found = designing.design_arm(
                description, held, prior, home, asked.time, asked.rate, asked.shown or designing.KINDS, reach, floor,
                criterion=criterion, progress=progress,
                waypoints=None if asked.waypoints is None else read_waypoints(asked.waypoints),
            )  # fmt: skip
    return asked.written(found)


def _limits(urdf: Path, asked: MotionOptions, description: Description) -> JointLimits:
    """Return the limits of the description, on top of those published of a robot, and below those of a file."""
    from joint_id_core.design.limit_files import published, read_limits

    known = None if asked.robot is None else published(Path(asked.robot).stem).of(description.joints)
    known = read_limits(urdf, description.joints, known)
    return known if asked.limits is None else read_limits(asked.limits, description.joints, known)


def _numbers(text: str, joints: Sequence[str]) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) != len(joints):
        raise JointIdError(f"--home {text}: give one number for each of {', '.join(joints)}, with commas between them")
    return found
