"""The messages of joint_id that hold signals, as ROS definitions, so that bags need no ROS installation.

They must agree with `joint_id_msgs/msg/*.msg`; a test compares the two.
"""

from __future__ import annotations

from functools import cache

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

DEFINITIONS = {
    "joint_id_msgs/msg/MotorVoltages": """
std_msgs/Header header
string[] name
float64[] voltage
""",
    "joint_id_msgs/msg/MotorTorques": """
std_msgs/Header header
string[] name
float64[] torque
""",
    "joint_id_msgs/msg/JointSamples": """
uint16 MOTOR_POSITION=1
uint16 MOTOR_VELOCITY=2
uint16 MOTOR_ACCELERATION=4
uint16 LINK_POSITION=8
uint16 LINK_VELOCITY=16
uint16 LINK_ACCELERATION=32
uint16 CURRENT=64
uint16 VOLTAGE=128
uint16 TORQUE=256
uint16 TEMPERATURE=512
uint16 EXTERNAL_TORQUE=1024
std_msgs/Header header
string[] name
uint16 measured
float64[] motor_position
float64[] motor_velocity
float64[] motor_acceleration
float64[] link_position
float64[] link_velocity
float64[] link_acceleration
float64[] current
float64[] voltage
float64[] torque
float64[] temperature
float64[] external_torque
""",
    "joint_id_msgs/msg/RobotSignals": """
std_msgs/Header header
string[] name
float64[] joint_temperatures
float64[] target_q
float64[] target_qd
float64[] target_qdd
float64[] target_current
float64[] target_moment
float64[] actual_current_as_torque
float64[] joint_control_output
""",
}


@cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy and of joint_id."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store
