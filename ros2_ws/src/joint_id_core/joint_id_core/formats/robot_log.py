"""Text files with a column for each field and joint of a UR robot, as RTDE recorders write: `actual_q_0`, `actual_q_1`.

Source: Universal Robots, RTDE client library, `record.py`: fields of six joints get its number at the end.
"""

from __future__ import annotations

from collections.abc import Collection

from joint_id_core.rtde.fields import JOINT_NAMES

RATIO = 101  # of the gears of a UR robot: see docs/tutorials/ur_robots.md
FIELDS = {
    "link_position": "actual_q", "motor_velocity": "actual_qd", "current": "actual_current",
    "reference_position": "target_q", "target_current": "target_current", "temperature": "joint_temperatures",
}  # fmt: skip


def joints(found: Collection[str]) -> tuple[str, ...]:
    """Return the joints of the columns `found`, as the robot's driver names them; () if this is no such file."""
    return tuple(name for k, name in enumerate(JOINT_NAMES) if f"{FIELDS['link_position']}_{k}" in found)


def columns(found: Collection[str], joint: str) -> dict[str, str]:
    """Return the mapping that reads a joint."""
    number = JOINT_NAMES.index(joint)
    own = {channel: f"{field}_{number}" for channel, field in FIELDS.items() if f"{field}_{number}" in found}
    if "motor_velocity" in own:
        own["motor_velocity"] = f"{RATIO}*{own['motor_velocity']}"
    return own
