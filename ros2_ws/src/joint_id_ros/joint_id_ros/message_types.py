"""ROS message classes by the name of their type."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from joint_id_core.errors import JointIdError


def message_class(type_name: str) -> Any:
    """Return the class of a type such as "sensor_msgs/msg/JointState".

    Raises:
        JointIdError: its package is not installed or not sourced.
    """
    package, _, name = type_name.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise JointIdError(f"the message type {type_name} is not installed: build and source its package") from None
