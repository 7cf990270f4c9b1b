"""Messages as a robot publishes them, from signals that are known in closed form."""

from __future__ import annotations

import math

from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState

from joint_id_msgs.msg import MotorVoltages

NANO = 10**9
PERIOD_NS = 2_000_000  # 500 Hz
RATIO = 101.0
AMPLITUDE, OMEGA = 0.3, 2.0 * math.pi  # link motion 0.3 sin(2 pi t) rad


def stamp(instant_ns: int) -> Time:
    """Stamp of an instant in ns."""
    return Time(sec=instant_ns // NANO, nanosec=instant_ns % NANO)


def link_position(t: float) -> float:
    """Link angle in rad at t in s."""
    return AMPLITUDE * math.sin(OMEGA * t)


def link_velocity(t: float) -> float:
    """Its derivative in rad/s."""
    return AMPLITUDE * OMEGA * math.cos(OMEGA * t)


def link_acceleration(t: float) -> float:
    """Its second derivative in rad/s^2."""
    return -AMPLITUDE * OMEGA**2 * math.sin(OMEGA * t)


def link_state(instant_ns: int, names: tuple[str, ...] = ("joint",)) -> JointState:
    """Position and current of all joints; joint k has k + 1 times the motion of the first."""
    t = instant_ns / NANO
    scale = range(1, len(names) + 1)
    message = JointState(name=list(names))
    message.position = [k * link_position(t) for k in scale]
    message.effort = [2.0 * k * link_position(t) for k in scale]
    message.header.stamp = stamp(instant_ns)
    return message


def motor_state(instant_ns: int, names: tuple[str, ...] = ("joint",)) -> JointState:
    """Position and velocity of a motor behind a stiff gear."""
    t = instant_ns / NANO
    scale = range(1, len(names) + 1)
    message = JointState(name=list(names))
    message.position = [RATIO * k * link_position(t) for k in scale]
    message.velocity = [RATIO * k * link_velocity(t) for k in scale]
    message.header.stamp = stamp(instant_ns)
    return message


def voltages(instant_ns: int, value: float, names: tuple[str, ...] = ("joint",)) -> MotorVoltages:
    """The same voltage on all motors."""
    message = MotorVoltages(name=list(names), voltage=[value] * len(names))
    message.header.stamp = stamp(instant_ns)
    return message
