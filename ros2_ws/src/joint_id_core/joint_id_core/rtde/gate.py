"""Which samples are fit to be used: a controller also sends some that are no measurements."""

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

_ZERO_MODE = RobotMode.DISCONNECTED  # what `robot_mode` is in a packet of zeros
_MEASURED = frozenset(f.name for f in FIELDS.values() if f.type == "VECTOR6D" and not f.name.startswith("target_"))


class Gate:
    """Looks at the samples of one robot in their order.

    A protective stop passes: what the sensors say then is true. So does a clock that was set back.
    """

    def __init__(self) -> None:
        self._last: Value = math.nan  # timestamp of the last sample that was none of zeros

    def admit(self, values: Mapping[str, Value]) -> str:
        """ "" for a sample that is fit, else why it is not; there are few such texts, so that they can be counted.

        The first of these that holds: "not finite" (NaN or infinity in any field), "too large" (a value that no robot
        has), "all zeros" (every six-vector that is measured is exactly zero, and the robot is not said to be off: a
        packet that was never filled), "repeated timestamp", "robot not running: MODE" (the brakes are on and the
        currents say nothing; only where `robot_mode` is among the fields).
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
