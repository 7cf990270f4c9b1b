"""`joint-id design`: a motion that shows what is asked, and what a fit of it will tell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from joint_id_core.cli.design_arm import ArmOption, ArmRequest, FitOption, FloorOption, design_of_arm
from joint_id_core.cli.design_joint import (
    CriterionOption,
    ForOption,
    JointOption,
    JointRequest,
    MotionOption,
    PlotOption,
    design_of_joint,
)
from joint_id_core.cli.fit_options import (
    BaseGravityOption,
    FixOption,
    FreeOption,
    JsonOption,
    PriorOption,
    SetOption,
    parameter_settings,
)
from joint_id_core.cli.options import with_options
from joint_id_core.cli.output import print_json
from joint_id_core.errors import JointIdError
from joint_id_core.models.options import ModelOptions

if TYPE_CHECKING:
    from joint_id_core.design.design import Design

OUT_HELP = "file to write: .csv, .yaml (JointTrajectory) or .script (URScript); repeatable"
ROBOT_HELP = "limits as published of ur3e, ur5e or ur10e; --joint: also set, fix and free of its parameter file"


@with_options("model_options", (ModelOptions,), no_default=("model",))
def design(
    model_options: dict[str, Any],
    joint: JointOption = None,
    arm: ArmOption = None,
    robot: Annotated[Optional[str], typer.Option(help=ROBOT_HELP)] = None,
    limits: Annotated[
        Optional[Path], typer.Option(help="limits: YAML as MoveIt's joint_limits.yaml, or a URDF")
    ] = None,
    time: Annotated[float, typer.Option(help="length of the motion, s")] = 20.0,
    rate: Annotated[float, typer.Option(help="samples a second, of the motion and of its recording")] = 500.0,
    home: Annotated[
        Optional[str],
        typer.Option(help="pose at start and end, rad; --arm: Q1,Q2,... (default: the middle of the limits)"),
    ] = None,
    reach: Annotated[Optional[float], typer.Option(help="how far a joint may go from home, rad (default: 1)")] = None,
    for_: ForOption = None,
    criterion: CriterionOption = "sigma",
    set_: SetOption = None,
    fix: FixOption = None,
    free: FreeOption = None,
    prior: PriorOption = None,
    motion: MotionOption = None,
    floor: FloorOption = None,
    fit: FitOption = None,
    base_gravity: BaseGravityOption = None,
    out: Annotated[Optional[list[Path]], typer.Option("--out", "-o", help=OUT_HELP)] = None,
    plot: PlotOption = None,
    json: JsonOption = False,
) -> None:
    """Design a motion that shows the parameters, and tell what a fit of it will know, before anything moves.

    Nothing is sent to a robot. Exit code 0: designed; 2: bad input.
    """
    if (joint is None) == (arm is None):
        raise JointIdError(
            "say what shall move: --joint NAME with --model and --robot or --limits, or --arm robot.urdf"
        )
    strange: dict[str, object] = {
        "--model": model_options,
        "--set": set_,
        "--fix": fix,
        "--free": free,
        "--prior": prior,
    }
    if arm is None:
        strange = {"--floor": floor is not None, "--fit": fit, "--base-gravity": base_gravity}
    if other := [option for option, given in strange.items() if given]:
        raise JointIdError(f"{other[0]} says nothing of {'one joint' if arm is None else 'a whole arm'}: leave it out")
    if arm is not None:
        whole = ArmRequest(arm, limits, robot, time, rate, home, reach, for_, motion, floor, fit, base_gravity)
        found: Design = design_of_arm(whole, out or (), plot)
    else:
        settings = parameter_settings(set_, fix, free, prior)
        asked = JointRequest(
            joint or "", model_options, settings, limits, robot, time, rate, home, reach, for_, criterion, motion
        )  # fmt: skip
        found = design_of_joint(asked, out or (), plot)
    if json:
        print_json(found.to_dict())
        return
    print(found)
    for path in out or ():
        print(f"\n{path}: look at it, then start it yourself; nothing was sent to a robot")
