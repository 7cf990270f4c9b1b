"""ROS parameters of the node that moves an emulated robot."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.errors import JointIdError
from joint_id_core.options import check, option


@dataclass(frozen=True)
class EmulatedMotionOptions:
    """The emulated robot."""

    socket: str = option("", "file through which the emulated robot takes commands: its option --socket; must be given")

    def __post_init__(self) -> None:
        check(self)
        if not self.socket:
            raise JointIdError("parameter socket is empty: give the file of joint-id robot-emulator --socket FILE")
