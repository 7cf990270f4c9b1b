"""Topics, message types and fields of the channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

JOINT_STATE = "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class Topic:
    """A topic: last part of its name, message type, and channel by array field."""

    name: str
    type: str
    fields: Mapping[str, str]


RAW = (
    Topic(
        "link_states",
        JOINT_STATE,
        {"position": "link_position", "velocity": "link_velocity", "effort": "current"},  # effort in A, not Nm
    ),
    Topic("motor_states", JOINT_STATE, {"position": "motor_position", "velocity": "motor_velocity"}),
    Topic("motor_voltages", "joint_id_msgs/msg/MotorVoltages", {"voltage": "voltage"}),
    Topic("motor_torques", "joint_id_msgs/msg/MotorTorques", {"torque": "torque"}),
)

# Conditions that change slowly: they are not joined to the samples by stamp, the newest value holds.
CONDITIONS = Topic("robot_signals", "joint_id_msgs/msg/RobotSignals", {"joint_temperatures": "temperature"})
# The same topic in a bag, where what the controller asks for goes with its samples.
SIGNALS = Topic(
    CONDITIONS.name,
    CONDITIONS.type,
    {**CONDITIONS.fields, "target_q": "reference_position", "target_current": "target_current"},
)
SIGNAL_FIELDS = (
    "joint_temperatures", "target_q", "target_qd", "target_qdd", "target_current", "target_moment",
    "actual_current_as_torque", "joint_control_output",
)  # fmt: skip

# Bit of each channel in JointSamples.measured.
MEASURED_BITS = {
    "motor_position": 1,
    "motor_velocity": 2,
    "motor_acceleration": 4,
    "link_position": 8,
    "link_velocity": 16,
    "link_acceleration": 32,
    "current": 64,
    "voltage": 128,
    "torque": 256,
    "temperature": 512,
    "external_torque": 1024,
}

SAMPLES = Topic("joint_samples", "joint_id_msgs/msg/JointSamples", {name: name for name in MEASURED_BITS})
