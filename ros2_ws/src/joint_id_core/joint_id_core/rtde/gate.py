"""Reject samples that are not measurements: a controller sends some of these, too."""

from __future__ import annotations

import math
from collections.abc import Mapping

from joint_id_core.data.signals import LARGEST
from joint_id_core.rtde.fields import FIELDS
from joint_id_core.rtde.modes import RobotMode, name_of
from joint_id_core.rtde.packets import Value

ALL_ZEROS, NOT_FINITE, TOO_LARGE, REPEATED, NOT_RUNNING = (
    "all zeros", "not finite", "too large", "repeated timestamp", "robot not running"
)  # fmt: skip

_ZERO_MODE = RobotMode.DISCONNECTED  # value of `robot_mode` in a packet of zeros
_MEASURED = frozenset(f.name for f in FIELDS.values() if f.type == "VECTOR6D" and not f.name.startswith("target_"))


class Gate:
    """Checks the samples of one robot, in their order.

    Samples during a protective stop are accepted, because the sensors are right then. So are samples after the clock
    was set back.
    """

    def __init__(self) -> None:
        self._last: Value = math.nan  # timestamp of the last sample that was not all zeros

    def admit(self, values: Mapping[str, Value]) -> str:
        """Return "" for a sample that can be used, else the reason. There are few reasons, so that they can be counted.

        Reasons, in the order of the checks:

        - "not finite" or "too large": NaN or infinity in a field, or a value that is impossible for a robot;
        - "all zeros": every measured six-vector is exactly zero, and the robot does not report that it is off: the
          controller never filled this packet;
        - "repeated timestamp";
        - "robot not running: MODE": the brakes are on, and the currents have no meaning. Checked only if `robot_mode`
          is among the fields.
        """
        filled = _MEASURED.isdisjoint(values)
        for name, value in values.items():
            if isinstance(value, tuple):
                if not sum(map(abs, value)) < LARGEST:
                    return TOO_LARGE if all(map(math.isfinite, value)) else NOT_FINITE
                filled = filled or (name in _MEASURED and any(value))
            elif isinstance(value, float) and not abs(value) < LARGEST:
                return TOO_LARGE if math.isfinite(value) else NOT_FINITE
        mode = values.get("robot_mode", RobotMode.RUNNING)
        if not filled and mode in (RobotMode.RUNNING, _ZERO_MODE):
            return ALL_ZEROS
        timestamp = values["timestamp"]
        last, self._last = self._last, timestamp
        if timestamp == last:
            return REPEATED
        if mode != RobotMode.RUNNING:
            return f"{NOT_RUNNING}: {name_of(RobotMode, mode)}"  # type: ignore[arg-type]  # is an INT32
        return ""
