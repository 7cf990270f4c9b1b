"""ROS parameters of the driver, in addition to those of its stream."""

from __future__ import annotations

from dataclasses import dataclass

from joint_id_core.errors import JointIdError
from joint_id_core.models.transmission import GEAR_RATIO
from joint_id_core.options import check, option
from joint_id_core.rtde.clients import CLIENTS
from joint_id_core.rtde.fields import JOINT_NAMES, JOINTS, PORT
from joint_id_msgs.msg import RobotSignals

EXTRA_FIELDS = tuple(f for f in RobotSignals.get_fields_and_field_types() if f not in ("header", "name"))


@dataclass(frozen=True)
class DriverOptions:
    """The robot to read from, and the signals to read."""

    robot_ip: str = option("", "name or address of the robot; must be given")
    port: int = option(PORT, "port of the robot's RTDE server", lower=1, upper=65535)
    client: str = option(
        "socket",
        "socket: our own client, takes every sample; ur_rtde: the library of that name, may miss samples",
        choices=tuple(CLIENTS),
    )
    rate: float = option(500.0, "samples a second; CB3 robots send at most 125, e-Series robots 500", "Hz", 1.0, 500.0)
    timeout: float = option(2.0, "longest wait for the connection and for each answer", "s", 0.1, 10.0)
    joints: tuple[str, ...] = option(JOINT_NAMES, "names of the six joints, from the base to the tool")
    gear_ratio: tuple[float, ...] = option((GEAR_RATIO,), "gear ratio of all joints, or one a joint", "1", 1e-6, 1e5)
    link_position_source: str = option("actual_q", "field or six registers in rad at the link; empty: not measured")
    motor_velocity_source: str = option(
        "actual_qd",
        "field (times the gear ratio) or six registers in rad/s at the motor shaft; empty: not measured",
    )
    motor_position_source: str = option(
        "", "field (times the gear ratio) or six registers in rad at the motor shaft; empty: not measured"
    )
    current_source: str = option("actual_current", "field or six registers in A; empty: not measured")
    extra_fields: tuple[str, ...] = option(
        ("joint_temperatures",),
        "what else to publish, on robot_signals; the filter passes the temperatures on",
        choices=EXTRA_FIELDS,
    )
    autostart: bool = option(True, "configure and activate at start, without a lifecycle manager")

    def __post_init__(self) -> None:
        check(self)
        if len(self.joints) != JOINTS or len(set(self.joints)) != JOINTS:
            names = ", ".join(self.joints)
            raise JointIdError(
                f"parameter joints = [{names}]: give {JOINTS} different names, from the base to the tool"
            )
        if len(self.gear_ratio) not in (1, JOINTS):
            raise JointIdError(
                f"parameter gear_ratio has {len(self.gear_ratio)} values: give one for all joints, or {JOINTS}"
            )
