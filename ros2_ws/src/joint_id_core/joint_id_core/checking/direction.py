"""Whether motor and link turn the same way: the gear ratio of all models is positive."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.sides import way
from joint_id_core.checking.signals import goes
from joint_id_core.data.recording import Recording

OPPOSITE = -0.9  # correlation of both ways; a twist is small beside them, an offset of a velocity leaves none
KINDS = ("position", "velocity")


def directions(recording: Recording) -> Iterator[Finding]:
    """Find a motor and a link that turn in opposite directions."""
    sides = [
        [f"{side}_{kind}" for kind in KINDS if _shows_motion(recording, f"{side}_{kind}")] for side in ("motor", "link")
    ]
    if not all(sides):
        return
    motor, link = sides[0][0], sides[1][0]
    (time, turned), (when, moved) = way(recording, motor), way(recording, link)
    if np.corrcoef(np.interp(when, time, turned), moved)[0, 1] < OPPOSITE:
        names = tuple(name for some in sides for name in some)
        yield Finding(
            f"{motor} and {link} turn in opposite directions: reverse the sign of one side in all its channels, as "
            f"--map {link}=-1*COLUMN, and that of the drive with the motor's",
            names,
        )


def _shows_motion(recording: Recording, name: str) -> bool:
    return recording.measured(name) and goes(name, recording[name])
