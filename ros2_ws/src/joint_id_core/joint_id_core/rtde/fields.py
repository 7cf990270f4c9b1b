"""The RTDE output fields that concern joints, and the binary layout of their types.

Source: Universal Robots, Real-Time Data Exchange (RTDE) guide.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

JOINTS = 6
# From the base to the tool, with the names of the manufacturer's robot descriptions and ROS driver.
JOINT_NAMES = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip
PORT = 30004

# struct code and number of elements by type
TYPES: dict[str, tuple[str, int]] = {
    "BOOL": ("?", 1),
    "UINT8": ("B", 1),
    "UINT32": ("I", 1),
    "UINT64": ("Q", 1),
    "INT32": ("i", 1),
    "DOUBLE": ("d", 1),
    "VECTOR3D": ("d", 3),
    "VECTOR6D": ("d", 6),
    "VECTOR6INT32": ("i", 6),
    "VECTOR6UINT32": ("I", 6),
}


@dataclass(frozen=True)
class Field:
    """An output field.

    `since` holds, by major version, the first controller version (major, minor) that sends it; empty for a field that
    all versions send.
    """

    name: str
    type: str
    unit: str
    meaning: str
    since: tuple[tuple[int, int], ...] = ()

    def sent_by(self, version: tuple[int, ...]) -> bool:
        """Return whether a controller of this version (major, minor, ...) has the field."""
        if not self.since:
            return True
        of_line = [first for first in self.since if first[0] == version[0]]
        return version[:2] >= of_line[0] if of_line else version[:2] >= max(self.since)


FIELDS: dict[str, Field] = {
    f.name: f
    for f in (
        Field("timestamp", "DOUBLE", "s", "time since the controller was started"),
        Field("target_q", "VECTOR6D", "rad", "target joint positions"),
        Field("target_qd", "VECTOR6D", "rad/s", "target joint velocities"),
        Field("target_qdd", "VECTOR6D", "rad/s^2", "target joint accelerations"),
        Field("target_current", "VECTOR6D", "A", "target motor currents"),
        Field("target_moment", "VECTOR6D", "Nm", "target joint torques of the controller's model, without friction"),
        Field("actual_q", "VECTOR6D", "rad", "joint positions, of the encoders at the links"),
        Field("actual_qd", "VECTOR6D", "rad/s", "joint velocities, of the motors divided by the gear ratio"),
        Field("actual_current", "VECTOR6D", "A", "motor currents"),
        Field(
            "actual_current_as_torque",
            "VECTOR6D",
            "Nm",
            "joint torques that the controller computes from the motor currents",
            since=((5, 23), (10, 11)),
        ),
        Field("joint_control_output", "VECTOR6D", "A", "control currents of the joints"),
        Field("joint_temperatures", "VECTOR6D", "deg C", "temperatures of the joints"),
        Field("actual_joint_voltage", "VECTOR6D", "V", "voltages of the supply rail at the joints, near 48 V"),
        Field("joint_mode", "VECTOR6INT32", "", "mode of every joint"),
        Field("robot_mode", "INT32", "", "mode of the robot"),
        Field("safety_mode", "INT32", "", "safety mode"),
        Field("robot_status_bits", "UINT32", "", "power on, program running, teach button, power button"),
        Field("safety_status_bits", "UINT32", "", "one bit a safety condition"),
        Field("speed_scaling", "DOUBLE", "1", "speed scaling of the trajectory limiter"),
    )
}

_REGISTER = re.compile(r"(?:input|output)_(int|double)_register_(\d+)")
_REGISTERS = 48
_REGISTER_TYPES = {"int": "INT32", "double": "DOUBLE"}


def register_type(name: str) -> str | None:
    """Return the type of a general purpose register such as `output_double_register_24`; None for other names."""
    match = _REGISTER.fullmatch(name)
    return _REGISTER_TYPES[match[1]] if match and int(match[2]) < _REGISTERS else None
