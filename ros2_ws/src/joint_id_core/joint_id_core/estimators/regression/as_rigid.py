"""Regression of any joint's recording as that of a rigid joint, moved by the torque or the current of its motor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from joint_id_core.checking.sides import MOTION
from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import across_gear
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.fit import regressed
from joint_id_core.estimators.regression.fitted import Fitted
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model, build


class Rigid(NamedTuple):
    """What a recording of any joint shows of a rigid one: its model, the recording and the settings for it.

    `side` is the one whose motion they have: "link" or "motor".
    """

    model: Model
    recording: Recording
    settings: ParameterSettings
    side: str


class AsRigid(NamedTuple):
    """Equations of a rigid joint, and the side whose motion they have: "link" or "motor"."""

    fitted: list[Fitted]
    side: str


def as_rigid(recording: Recording, values: Mapping[str, float] | None = None, gravity: bool = True) -> Rigid | None:
    """Return a recording as that of a rigid joint; None if a drive or a motion is not measured.

    Of two sides, the link's is taken.

    Args:
        recording: of any joint.
        values: gear ratio `N` and torque constant `k_t`; 1 if missing. Of the motor's side, the gear ratio is 1.
        gravity: whether the model has gravity, if the angle of the link is measured.
    """
    measured = [n for n in recording.channels if recording.measured(n)]
    drive = next((n for n in ("torque", "current") if n in measured), None)
    sides = [side for side in ("link", "motor") if any(n in measured for n in MOTION if n.startswith(side))]
    if drive is None or not sides:
        return None
    channels = {n: recording[n] for n in measured if n.startswith(sides[0]) or n == drive}
    channels |= {n: recording[n] for n in ("external_torque",) if n in recording}  # it may be computed
    if sides[0] == "motor":
        channels = {across_gear(n) or n: values for n, values in channels.items()}
    has_angle = sides[0] == "link" and "link_position" in channels
    model = build("rigid_joint", gravity=gravity and has_angle, actuation=drive)
    given = {"N": 1.0, "k_t": 1.0, **(values or {})}
    constants = {"N": given["N"] if sides[0] == "link" else 1.0}
    constants |= {"k_t": given["k_t"]} if drive == "current" else {}
    part = Recording(recording.time, channels, source=recording.source)
    return Rigid(model, part, ParameterSettings(constants), sides[0])


def regressed_as_rigid(recording: Recording, values: Mapping[str, float] | None = None) -> AsRigid | None:
    """Return the regression of a recording as that of a rigid joint; arguments and None as of `as_rigid`.

    Raises:
        JointIdError: the recording cannot be used.
    """
    rigid = as_rigid(recording, values)
    if rigid is None:
        return None
    return AsRigid(regressed(rigid.model, rigid.recording, rigid.settings, Regression()), rigid.side)
