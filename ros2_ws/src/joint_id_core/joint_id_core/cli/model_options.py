"""Options that choose and build a model, the same for every command."""

from __future__ import annotations

from typing import Annotated, get_args

import typer

from joint_id_core.errors import JointIdError
from joint_id_core.models import LAWS, MODELS, Model, build
from joint_id_core.models.transmission import Actuation

Texts = list[str] | None
MODEL_HELP = f"one of {', '.join(MODELS)}"
SetOption = Annotated[Texts, typer.Option("--set", help="NAME=VALUE: start value, or value of a held parameter")]
ActuationOption = Annotated[str | None, typer.Option(help="torque or current (default: torque if it is recorded)")]
FrictionOption = Annotated[str | None, typer.Option(help=f"one of {', '.join(LAWS)}")]
GravityOption = Annotated[bool, typer.Option("--gravity", help="the axis is not vertical: adds a_g, b_g")]
DelaysOption = Annotated[bool, typer.Option("--delays", help="sensors may be late: adds delta_p, delta_q")]
OffsetsOption = Annotated[bool, typer.Option("--offsets", help="of torque and twist: adds tau_0, dtheta_0")]
KinematicErrorOption = Annotated[bool, typer.Option("--kinematic-error", help="of the gear: adds a_ke, phi_ke")]


def build_model(name: str, actuation: str | None, friction: str | None, **flags: bool) -> Model:
    """Build a model with the options that were given and the flags that are set.

    Raises:
        JointIdError: unknown model, option or choice.
    """
    if actuation is not None and actuation not in get_args(Actuation):
        raise JointIdError(f"unknown actuation {actuation!r}: choose one of {', '.join(get_args(Actuation))}")
    options: dict[str, str | bool] = {flag: True for flag, is_set in flags.items() if is_set}
    if actuation is not None:
        options["actuation"] = actuation
    if friction is not None:
        options["friction"] = friction
    return build(name, **options)
