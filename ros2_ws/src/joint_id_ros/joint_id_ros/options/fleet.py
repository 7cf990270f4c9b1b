"""ROS parameters of the fleet: the robots, and the processes that they share."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option


@dataclass(frozen=True)
class FleetOptions:
    """Which robots are identified, and in how many processes.

    Raises:
        JointIdError: no file, or a part that is not one of the processes.
    """

    robots: str = option("", "YAML file with the robots; must be given")
    processes: int = option(1, "processes that share the robots; about one a core is best", lower=1, upper=64)
    part: int = option(
        0, "the robots that this process has: every processes-th, beginning with this one; 0: start them all",
        lower=0, upper=64,
    )  # fmt: skip

    def __post_init__(self) -> None:
        check(self)
        if not self.robots:
            raise JointIdError("parameter robots is missing: give the YAML file with the robots")
        if self.part > self.processes:
            raise JointIdError(f"parameter part = {self.part}: there are {self.processes} processes")
