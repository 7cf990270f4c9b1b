"""What can be wrong with a robot; which of it may pass by itself decides whether to try again."""

from __future__ import annotations

from joint_id_core.errors import JointIdError


class RobotError(JointIdError):
    """Something is wrong with the robot or with the way to it."""


class UnreachableError(RobotError):
    """No connection, or it was lost, or it fell silent: may pass by itself."""


class ProtocolError(RobotError):
    """What arrived is not RTDE: the connection is of no more use, a new one may be."""


class RefusedError(RobotError):
    """The controller does not offer what is asked for: passes only when one of the two changes."""
