"""Joint models. `build` makes one by its registry name."""

from __future__ import annotations

from dataclasses import fields

from joint_id_core.errors import JointIdError, close_to
from joint_id_core.models.base import Model as Model
from joint_id_core.models.base import Ops as Ops
from joint_id_core.models.dc_motor import DCMotor as DCMotor
from joint_id_core.models.electromechanical import Electromechanical as Electromechanical
from joint_id_core.models.friction import LAWS as LAWS
from joint_id_core.models.harmonic_drive import HarmonicDrive as HarmonicDrive
from joint_id_core.models.motor_side import MotorSide as MotorSide
from joint_id_core.models.rigid_joint import RigidJoint as RigidJoint

MODELS: dict[str, type[Model]] = {m.name: m for m in (DCMotor, HarmonicDrive, Electromechanical, RigidJoint, MotorSide)}


def build(name: str, **options: str | bool) -> Model:
    """Build the model called `name` with its options (`actuation`, `friction`, `gravity`, `kinematic_error`).

    Raises:
        JointIdError: no such model, an option that this model does not have, or a value that it does not take.
    """
    if name not in MODELS:
        raise JointIdError(f"unknown model {name!r}{close_to(name, MODELS)}: choose one of {', '.join(MODELS)}")
    known = {f.name for f in fields(MODELS[name])}
    for option in options:
        if option not in known:
            raise JointIdError(f"model {name} has no option {option!r}: it has {', '.join(sorted(known)) or 'none'}")
    return MODELS[name](**options)
