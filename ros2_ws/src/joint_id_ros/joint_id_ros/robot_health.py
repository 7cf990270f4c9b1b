"""State of the robot and of its connection, from its samples, for diagnostics and log of the driver."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from joint_id_core.rtde.gate import NOT_RUNNING
from joint_id_core.rtde.modes import JointMode, RobotMode, SafetyMode, name_of
from joint_id_core.rtde.stream import StreamState, StreamStatus
from joint_id_ros.diagnostics import Health

MODES: dict[str, tuple[type[IntEnum], IntEnum]] = {
    "robot_mode": (RobotMode, RobotMode.RUNNING),
    "safety_mode": (SafetyMode, SafetyMode.NORMAL),
}


class RobotHealth:
    """Tracks the modes of the robot and counts the rejected samples."""

    def __init__(self, joints: Sequence[str], rate: float, tell: Callable[[str, str], None]) -> None:
        """Prepare the report; `tell` is called with kind and text of a change, from the thread of `note`.

        A change of kind "mode" is not a problem.
        """
        self._joints, self._rate, self._tell = tuple(joints), rate, tell
        self._newest: Mapping[str, Any] = {}
        self._held: Counter[str] = Counter()
        self._reason = ""

    def note(self, values: Mapping[str, Any], reason: str) -> None:
        """Record a sample, with the reason why the gate rejects it ("" if it does not)."""
        if reason:
            self._held[reason] += 1
        if reason and not reason.startswith(NOT_RUNNING):
            if reason != self._reason:
                self._tell("samples held back", f"samples held back: {reason}")
        else:
            self._note_modes(values)
        self._reason = reason

    def _note_modes(self, values: Mapping[str, Any]) -> None:
        before, self._newest = self._newest, values
        for field, (kind, usual) in MODES.items():
            if values[field] != before.get(field):
                was = f", was {name_of(kind, before[field])}" if before else ""
                what = field.replace("_", " ")
                self._tell("mode" if values[field] == usual else what, f"{what} is {name_of(kind, values[field])}{was}")

    def report(self, status: StreamStatus) -> Health:
        """Return level, a sentence, and values by name."""
        values: dict[str, object] = {
            "connection": status.state.value,
            "controller version": ".".join(map(str, status.version)) or "not known",
            "rate asked [Hz]": f"{self._rate:g}",
            "lost": status.lost,
            "reconnects": status.reconnects,
            "age of the newest sample [s]": f"{status.age_s:.3f}",
        }
        values |= {f"held back: {reason}": n for reason, n in sorted(self._held.copy().items())}
        newest, unusual = self._newest, []
        for field, (kind, usual) in MODES.items() if newest else ():
            values[field.replace("_", " ")] = name = name_of(kind, newest[field])
            if newest[field] != usual:
                unusual.append(f"{field.replace('_', ' ')} is {name}")
        for field, text in (("joint_mode", "mode"), ("joint_temperatures", "temperature [deg C]")):
            for joint, value in zip(self._joints, newest.get(field, ()), strict=False):
                values[f"{joint}: {text}"] = name_of(JointMode, value) if field == "joint_mode" else f"{value:.1f}"
        if status.state is not StreamState.STREAMING:
            why = f": {status.error}" if status.error else ""
            return Health(DiagnosticStatus.ERROR, f"not connected ({status.state.value}){why}", values)
        if not newest:
            return Health(DiagnosticStatus.WARN, "connected, no sample yet", values)
        level = DiagnosticStatus.WARN if unusual else DiagnosticStatus.OK
        return Health(level, "; ".join(unusual) or "publishing", values)
