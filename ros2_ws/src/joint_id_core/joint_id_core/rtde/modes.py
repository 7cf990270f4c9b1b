"""Names of robot, safety and joint modes. Source: Universal Robots, RTDE and Client Interface guides."""

from __future__ import annotations

from enum import IntEnum


class RobotMode(IntEnum):
    """Mode of the robot; only in RUNNING the brakes are released and the joints are controlled."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """Mode of the safety system."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED_SAFETY_MODE = 11


class JointMode(IntEnum):
    """Mode of one joint."""

    RESET = 235
    SHUTTING_DOWN = 236
    PART_D_CALIBRATION = 237
    BACKDRIVE = 238
    POWER_OFF = 239
    READY_FOR_POWER_OFF = 240
    NOT_RESPONDING = 245
    MOTOR_INITIALISATION = 246
    BOOTING = 247
    PART_D_CALIBRATION_ERROR = 248
    BOOTLOADER = 249
    CALIBRATION = 250
    VIOLATION = 251
    FAULT = 252
    RUNNING = 253
    IDLE = 255


def name_of(kind: type[IntEnum], number: float) -> str:
    """Return the name of a mode; "unknown" with its number if it has none."""
    try:
        return kind(int(number)).name
    except ValueError:
        return f"unknown ({number:g})"
