"""ROS parameters of the nodes that know the description of the robot: filter and arm identifier."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.arm.description import GRAVITY, checked_gravity
from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option


@dataclass(frozen=True)
class LoadOptions:
    """Where the description of the robot comes from; without one, no load is computed.

    Raises:
        JointIdError: two sources, or a gravity that is none.
    """

    description_topic: str = option(
        "",
        "topic with the description (URDF) of the robot, such as robot_description: the load of the rest of the arm is "
        "computed from it and goes with the samples of every joint",
    )
    urdf: str = option("", "the same from a URDF file; what it lacks ends the node at its start")
    base_gravity: tuple[float, ...] = option(
        GRAVITY, "gravity in the frame of the robot's base; this one is of a base that stands on the floor", "m/s^2"
    )

    def __post_init__(self) -> None:
        check(self)
        checked_gravity(self.base_gravity)
        if self.description_topic and self.urdf:
            raise JointIdError(f"parameters description_topic and urdf = {self.urdf} are both given: leave one out")

    @property
    def given(self) -> bool:
        """Whether there is a description."""
        return bool(self.description_topic or self.urdf)
