"""Options of a model: the only source for the command line, ROS parameters and launch arguments."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from joint_id_core.models import LAWS, MODELS, Model, build
from joint_id_core.models.transmission import DRIVES
from joint_id_core.options import check, option

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording

FLAGS = ("gravity", "kinematic_error", "delays", "offsets", "drifting_load")


@dataclass(frozen=True)
class ModelOptions:
    """A joint model and its options. The default of an option is ignored for a model that does not have this option.

    Raises:
        JointIdError: a value that is not one of the choices.
    """

    model: str = option("electromechanical", "joint model", choices=tuple(MODELS))
    actuation: str = option("", "drive signal; empty: torque if it is recorded, else current", choices=("", *DRIVES))
    friction: str = option(LAWS[0], "friction law", choices=LAWS)
    gravity: bool = option(False, "the axis is not vertical: adds a_g, b_g")
    kinematic_error: bool = option(False, "kinematic error of the gear: adds a_ke, phi_ke")
    delays: bool = option(False, "sensors may be late: adds delta_p, delta_q")
    offsets: bool = option(False, "offsets of torque and twist: adds tau_0, dtheta_0")
    drifting_load: bool = option(False, "other joints or hands move the link, too: adds a load that drifts")

    def __post_init__(self) -> None:
        check(self)

    @property
    def drives(self) -> tuple[str, ...]:
        """Possible drive signals: the given actuation, or all of them if none is given."""
        return (self.actuation,) if self.actuation else DRIVES

    def drive_in(self, recording: Recording) -> str:
        """Return the drive signal for this recording: the given actuation, else torque if recorded, else current.

        Empty for models that are driven by neither torque nor current.
        """
        return self.actuation or drive_of(self.model, recording) or ""

    def build(self, drive: str = "") -> Model:
        """Build the model, driven by `drive` if its drive can be chosen.

        Raises:
            JointIdError: an option that the model does not have, with a value other than the default.
        """
        own = {f.name for f in fields(MODELS[self.model])}
        defaults = {f.name: f.default for f in fields(self)}
        given = {n: getattr(self, n) for n in ("actuation", "friction", *FLAGS)}
        chosen = {n: v for n, v in given.items() if v != "" and (n in own or v != defaults[n])}
        return build(self.model, **(chosen | ({"actuation": drive} if drive and "actuation" in own else {})))


def drive_of(model: str, recording: Recording) -> str | None:
    """Return the recorded drive signal of a model that can be driven by torque or current; None for other models."""
    if "actuation" not in {f.name for f in fields(MODELS[model])}:
        return None
    return "torque" if recording.measured("torque") or not recording.measured("current") else "current"
