"""Errors of the connection to a robot. The type decides whether it is useful to try again."""

from __future__ import annotations

from joint_id_core.errors import JointIdError


class RobotError(JointIdError):
    """An error of the robot or of the connection to it."""


class UnreachableError(RobotError):
    """No connection, a lost connection, or a silent one: the error may disappear by itself."""


class ProtocolError(RobotError):
    """The received data are not RTDE: this connection cannot be used any more, but a new one may work."""


class RefusedError(RobotError):
    """The controller does not offer what was requested: it helps only to change the request or the controller."""
