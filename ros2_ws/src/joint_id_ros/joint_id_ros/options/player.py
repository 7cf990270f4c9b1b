"""ROS parameters of the player."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option


@dataclass(frozen=True)
class PlayerOptions:
    """The bag to play, and the speed."""

    bag: str = option("", "bag to play: a directory, or a bare .mcap or .db3 file")
    topics: tuple[str, ...] = option((), "topics to play; none: all but those that the other nodes compute again")
    rate: float = option(1.0, "speed as a multiple of the recorded one; 0 plays as fast as the readers keep up",
                         "1", 0.0, 1e3)  # fmt: skip
    clock: bool = option(True, "publish /clock with the time of the bag, for nodes with use_sim_time")
    wait_s: float = option(10.0, "longest wait for a subscriber on every topic before playing", "s", 0.0, 1e4)
    wait_first_s: float = option(0.0, "longest wait for the first subscriber on any topic, if it is longer than wait_s",
                                 "s", 0.0, 1e4)  # fmt: skip

    def __post_init__(self) -> None:
        check(self)
        if not self.bag:
            raise JointIdError("parameter bag is empty: give the bag to play, e.g. -p bag:=recordings/run1")
