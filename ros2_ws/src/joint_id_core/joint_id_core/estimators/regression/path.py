"""The motion along which instruments are computed: that of the command, or that of the motor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.checking.command import COMMAND, follows
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import derivative_of, side_of
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.filtering.offline import FilterOptions, differentiate


@dataclass(frozen=True)
class Path:
    """Angle, velocity and acceleration of the link of a rigid joint, each of shape (T,), SI units."""

    angle: Array
    velocity: Array
    acceleration: Array

    def motion(self, like: Motion, ratio: float) -> Motion:
        """Return the motion of a rigid joint with a gear ratio, with the inputs of `like` that are no motion."""
        kinds = {"position": self.angle, "velocity": self.velocity, "acceleration": self.acceleration}

        def along(name: str | None, own: Array) -> Array:
            side = side_of(name or "")
            if name is None or side is None:
                return own
            return np.asarray((ratio if side == "motor" else 1.0) * kinds[name.removeprefix(f"{side}_")])

        x, u = ({n: along(n, v) for n, v in part.items()} for part in (like.x, like.u))
        return Motion(x, u, {n: along(derivative_of(n), v) for n, v in like.rates.items()})


def of_motor(moved: Motion, ratio: float) -> Path:
    """Return the path of the motor, divided by the gear ratio."""
    return Path(
        moved.x["motor_position"] / ratio, moved.x["motor_velocity"] / ratio, moved.rates["motor_velocity"] / ratio
    )


def commanded(recording: Recording, angle: Array, cutoff_hz: float) -> Path | None:
    """Return the path of the command behind a low-pass; None if the angle of the link (T,) does not follow any."""
    command = recording.channels.get(COMMAND)
    if command is None or not follows(command, angle):
        return None
    return Path(*differentiate(recording.time, command, FilterOptions(cutoff_hz=cutoff_hz), 2))


def required(path: Path | None, recording: Recording) -> Path:
    """Return the path of a command that the user asks for.

    Raises:
        JointIdError: there is none.
    """
    if path is None:
        raise JointIdError(
            f"instruments = command: {recording.source} has no {COMMAND} (the commanded angle of the link, rad) that "
            "the link follows; add it, or leave this option out"
        )
    return path
