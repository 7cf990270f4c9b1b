"""ROS parameters of the node that identifies joints by a motion made for it."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.options import check, option


@dataclass(frozen=True)
class IdentifyOptions:
    """The robot, where the results go, and how long the node waits."""

    robot: str = option(
        "", "parameter file of the identifier, or its name such as ur3e: gear ratios and torque constants; empty: none"
    )
    limits: str = option(
        "", "file of limits for planned motions, as joint-id design --limits; empty: those published of the robot"
    )
    reach: float = option(1.0, "how far a planned motion may go from where the joint is", "rad", 0.01, 10.0)
    urdf: str = option("", "description of the arm, where several joints move: the load on each; empty: none")
    directory: str = option(".", "folder for recordings, trajectories and reports")
    wait_s: float = option(
        600.0, "longest wait for the go, and for a motion that the user starts at the robot", "s", 0.1, 1e5
    )
    silent_s: float = option(
        2.0, "time without samples after which a motion is stopped and the goal ends", "s", 0.1, 100.0
    )
    autostart: bool = option(True, "configure and activate at start, without a lifecycle manager")

    def __post_init__(self) -> None:
        check(self)
