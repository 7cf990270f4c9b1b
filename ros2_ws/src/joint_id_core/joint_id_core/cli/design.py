"""`joint-id design`: a motion that shows what is asked, and what a fit of it will tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from joint_id_core.cli.design_arm import ArmOption, FitOption, FloorOption, design_of_arm
from joint_id_core.cli.design_joint import CriterionOption, JointOption, design_of_joint
from joint_id_core.cli.fit_options import (
    BaseGravityOption,
    FixOption,
    FreeOption,
    JsonOption,
    PriorOption,
    SetOption,
    parameter_settings,
)
from joint_id_core.cli.motion_options import MotionOptions
from joint_id_core.cli.options import with_group, with_options
from joint_id_core.cli.output import print_json
from joint_id_core.errors import JointIdError
from joint_id_core.models.options import ModelOptions

if TYPE_CHECKING:
    from joint_id_core.design.design import Design


@with_options("model_options", (ModelOptions,), no_default=("model",))
@with_group("options", MotionOptions)
def design(
    model_options: dict[str, Any],
    options: MotionOptions,
    joint: JointOption = None,
    arm: ArmOption = None,
    criterion: CriterionOption = "sigma",
    set_: SetOption = None,
    fix: FixOption = None,
    free: FreeOption = None,
    prior: PriorOption = None,
    floor: FloorOption = None,
    fit: FitOption = None,
    base_gravity: BaseGravityOption = None,
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
    options.require_one_motion()
    found: Design
    if arm is not None:
        found = design_of_arm(arm, options, criterion, floor, fit, base_gravity)
    else:
        settings = parameter_settings(set_, fix, free, prior)
        found = design_of_joint(joint or "", model_options, settings, options, criterion)
    if json:
        print_json(found.to_dict())
        return
    print(found)
    for path in options.out or ():
        print(f"\n{path}: look at it, then start it yourself; nothing was sent to a robot")
