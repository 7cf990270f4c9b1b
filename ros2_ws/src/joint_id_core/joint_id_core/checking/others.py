"""Other joints of the same robot that move at the same time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.signals import joint_moves
from joint_id_core.data.recording import Recording

SIDES = ("link", "motor")


def others_move(recording: Recording, all_joints: Sequence[Recording]) -> Iterator[Finding]:
    """Find motion of other joints during the recording of this one: their load acts on it."""
    if not joint_moves(recording):
        return
    start, end = (recording.origin + recording.time[k] for k in (0, -1))
    told = []
    for other in all_joints:
        if other.joint == recording.joint or len(other) < 2:
            continue
        meanwhile = other.window(start - other.origin, end - other.origin + 1e-9)
        if len(meanwhile) > 2 and joint_moves(meanwhile):
            told.append(f"{other.joint}{_speed(meanwhile)}")
    if told:
        yield Finding(
            f"Other joints move at the same time: {', '.join(told)}; their load acts on this joint, and a model of "
            "one joint lacks it: give the robot's description (--urdf), move one joint at a time, or take "
            "harmonic_drive --drifting-load (motor_side) where both sides of the gear are measured"
        )


def _speed(recording: Recording) -> str:
    """Return the rms velocity of a joint in words; motor side only where there is no link."""
    for side in SIDES:
        velocity, position = f"{side}_velocity", f"{side}_position"
        unit = "rad/s" if side == "link" else "rad/s at the motor"
        for name in (velocity, position):
            if recording.measured(name):
                seen = np.isfinite(recording[name])
                time, rates = recording.time[seen], recording[name][seen]
                if name == position:
                    rates = np.gradient(rates, time)
                return f" ({float(np.sqrt(np.mean(rates**2))):.2g} {unit} rms)"
    return ""
