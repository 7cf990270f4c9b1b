"""ROS parameters of the arm identifier."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.arm.description import GRAVITY, checked_gravity
from joint_id_core.errors import JointIdError
from joint_id_core.models.per_joint import Entry, parse
from joint_id_core.options import check, option


@dataclass(frozen=True)
class ArmIdentifierOptions:
    """Description of the robot, its drives, and where what is known is kept.

    Raises:
        JointIdError: a gravity that is none, no description, or an entry of `set` of another form.
    """

    description_topic: str = option("robot_description", "topic with the description (URDF) of the robot")
    urdf: str = option("", "a URDF file to take in place of that topic")
    base_gravity: tuple[float, ...] = option(
        GRAVITY, "gravity in the frame of the robot's base; this one is of a base that stands on the floor", "m/s^2"
    )
    set: tuple[str, ...] = option(
        (), 'torque constants and gear ratios, as "k_t=VALUE" and "N=VALUE", or for one joint "JOINT.k_t=VALUE"'
    )
    state_file: str = option(
        "", "file that keeps what is known of the arm, so that a restart goes on with it; empty: none"
    )
    autostart: bool = option(True, "configure and activate at start, without a lifecycle manager")

    def __post_init__(self) -> None:
        check(self)
        checked_gravity(self.base_gravity)
        if not (self.urdf or self.description_topic):
            raise JointIdError("no description of the robot: set the parameter urdf or description_topic")
        self.entries  # noqa: B018  # checks them

    @property
    def entries(self) -> list[Entry]:
        """The entries of `set`.

        Raises:
            JointIdError: one of another form.
        """
        return [parse(text, "set") for text in self.set]
