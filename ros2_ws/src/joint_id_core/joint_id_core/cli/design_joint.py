"""`joint-id design --joint NAME`: a motion for one joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from joint_id_core.cli.motion_options import MotionOptions
from joint_id_core.cli.output import Progress
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.estimators import ParameterSettings
from joint_id_core.models.options import ModelOptions

if TYPE_CHECKING:
    from joint_id_core.design.design import Design
    from joint_id_core.design.limits import JointLimits
    from joint_id_core.models import Model

SUFFIX = "_joint"  # of the joints of a UR robot, which may be left out
JointOption = Annotated[Optional[str], typer.Option(help="a motion for this joint alone, e.g. elbow_joint")]
CRITERION_HELP = (
    "what is least: sigma (the standard deviations, geometric mean), D (the volume of their ellipsoid), "
    "A (the sum of the variances)"
)
CriterionOption = Annotated[str, typer.Option(help=CRITERION_HELP)]


def design_of_joint(
    name: str, model_options: Mapping[str, Any], settings: ParameterSettings, asked: MotionOptions, criterion: str
) -> Design:
    """Design the motion, write and plot it.

    Raises:
        JointIdError: bad input, see `joint_id_core.design.joint.design_joint`.
    """
    from joint_id_core.design import joint as designing
    from joint_id_core.design.files import read_trajectory
    from joint_id_core.design.limits import violations
    from joint_id_core.design.waypoints import read_waypoints

    asked.require_writable([Path(asked.robot) if asked.robot else None])
    joint, held = _limits(name, asked)
    model, settings = _model(model_options, settings, asked.robot, joint)
    reach = designing.REACH if asked.reach is None else asked.reach
    with Progress() as progress:
        if asked.motion is not None:
            trajectory = read_trajectory(asked.motion)
            if joint in trajectory.names and len(trajectory.names) > 1:
                trajectory = trajectory.of(joint)
            found = designing.foretell(designing.Foresight(model, settings, asked.rate), trajectory)
            own = replace(held, names=trajectory.names)  # a motion of another origin may name its one joint otherwise
            broken = (f"It breaks a limit: {text}." for text in violations(trajectory, own))
            found = replace(found, notes=(*broken, *found.notes))
        else:
            asked.require_program((joint,), asked.rate)
            home = None if asked.home is None else _number(asked.home)
            found = designing.design_joint(
                model, held, settings, asked.time, asked.shown, criterion, home, reach, asked.rate, progress=progress,
                waypoints=None if asked.waypoints is None else read_waypoints(asked.waypoints),
            )  # fmt: skip
    return asked.written(found)


def _limits(name: str, asked: MotionOptions) -> tuple[str, JointLimits]:
    """Return the whole name of the joint and its limits: those published of a robot, and over them those of a file."""
    from joint_id_core.design.limit_files import joints_with_limits, published, read_limits

    known = None
    if asked.robot is not None:
        robot = Path(asked.robot).stem
        try:
            known = published(robot)
        except JointIdError:
            if asked.limits is None:
                raise
    if known is not None:
        names = known.names
    elif asked.limits is not None:
        names = joints_with_limits(asked.limits, name)
    else:
        raise JointIdError(
            "no limits are known: name a robot (--robot ur3e), or give a URDF or a file of limits (--limits FILE)"
        )
    joint = name + SUFFIX if name not in names and name + SUFFIX in names else name
    if known is not None and joint not in known.names:
        raise JointIdError(
            f"--joint {joint}: {asked.robot} has no such joint{close_to(joint, known.names)}: it has "
            f"{', '.join(known.names)}"
        )
    own = None if known is None else known.of((joint,))
    if asked.limits is not None:
        own = read_limits(asked.limits, (joint,), own)
    assert own is not None
    return joint, own


def _model(
    model_options: Mapping[str, Any], settings: ParameterSettings, robot: str | None, joint: str
) -> tuple[Model, ParameterSettings]:
    """Return the model and its settings, with those of the robot's file for the joint below the user's."""
    from joint_id_core.design.plant import plant_of
    from joint_id_core.jobs.robot_file import robot_settings

    if "model" not in model_options:
        raise JointIdError(
            "--joint needs --model: motor_side, harmonic_drive or rigid_joint, that which will be fitted"
        )
    options = ModelOptions(**model_options)
    # robots report currents; a torque is the default of models alone
    model = options.build(options.actuation or ("current" if robot else "torque"))
    if robot is not None:
        names = {*model.parameter_names, *plant_of(model).parameter_names}
        settings = settings.over(robot_settings(robot, joint, names))
    return model, settings


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise JointIdError(f"--home {text}: give one number in rad, for --joint") from None
