"""Options that choose and build a model: the one source for the command line, ROS parameters and launch arguments."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, get_args

from joint_id_core.models import LAWS, MODELS, Model, build
from joint_id_core.models.transmission import Actuation
from joint_id_core.options import check, option

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording

DRIVES: tuple[str, ...] = get_args(Actuation)
FLAGS = ("gravity", "kinematic_error", "delays", "offsets")


@dataclass(frozen=True)
class ModelOptions:
    """Which joint model, with which options. A model that lacks an option ignores that option's default.

    Raises:
        JointIdError: a value outside its choices.
    """

    model: str = option("electromechanical", "joint model", choices=tuple(MODELS))
    actuation: str = option("", "drive signal; empty: torque if it is recorded, else current", choices=("", *DRIVES))
    friction: str = option(LAWS[0], "friction law", choices=LAWS)
    gravity: bool = option(False, "the axis is not vertical: adds a_g, b_g")
    kinematic_error: bool = option(False, "kinematic error of the gear: adds a_ke, phi_ke")
    delays: bool = option(False, "sensors may be late: adds delta_p, delta_q")
    offsets: bool = option(False, "offsets of torque and twist: adds tau_0, dtheta_0")

    def __post_init__(self) -> None:
        check(self)

    @property
    def drives(self) -> tuple[str, ...]:
        """What may drive the model: the actuation that is given, or each there is."""
        return (self.actuation,) if self.actuation else DRIVES

    def drive_in(self, recording: Recording) -> str:
        """What drives the joint in this recording: the actuation that is given, else torque if recorded, else current.

        Empty for models that are driven by neither.
        """
        return self.actuation or drive_of(self.model, recording) or ""

    def build(self, drive: str = "") -> Model:
        """The model, driven by `drive` if it has such an input; an option that it lacks may stay at its default.

        Raises:
            JointIdError: an option that the model does not have.
        """
        own = {f.name for f in fields(MODELS[self.model])}
        defaults = {f.name: f.default for f in fields(self)}
        given = {n: getattr(self, n) for n in ("actuation", "friction", *FLAGS)}
        chosen = {n: v for n, v in given.items() if v != "" and (n in own or v != defaults[n])}
        return build(self.model, **(chosen | ({"actuation": drive} if drive and "actuation" in own else {})))


def drive_of(model: str, recording: Recording) -> str | None:
    """The recorded drive signal, for a model that can be driven by torque or by current; None for the others."""
    if "actuation" not in {f.name for f in fields(MODELS[model])}:
        return None
    return "torque" if recording.measured("torque") or not recording.measured("current") else "current"
