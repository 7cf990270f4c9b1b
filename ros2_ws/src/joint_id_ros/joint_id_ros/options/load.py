"""ROS parameters of filter and identifier that tell the description of the robot."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.arm.description import GRAVITY, checked_gravity
from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option


@dataclass(frozen=True)
class LoadOptions:
    """Where the description of the robot comes from.

    The filter computes the load of the joints from it, and the identifier what this may be off by.

    Raises:
        JointIdError: two sources, or a gravity that is none.
    """

    description_topic: str = option(
        "",
        "topic with the description (URDF) of the robot, such as robot_description: the filter adds the load of the "
        "rest of the arm to the samples of every joint, the identifier matches it to the motion",
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
