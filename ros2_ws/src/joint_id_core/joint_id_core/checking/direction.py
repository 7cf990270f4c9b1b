"""Whether motor and link turn the same way, and the motor not less: the gear ratio of all models is positive."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.sides import way
from joint_id_core.checking.signals import goes
from joint_id_core.data.recording import Recording

OPPOSITE = -0.9  # correlation of both ways; a twist is small beside them, an offset of a velocity leaves none
LEAST_RATIO = 0.5  # of motor over link: gears of robots make the link slower
KINDS = ("position", "velocity")


def directions(recording: Recording) -> Iterator[Finding]:
    """Find a motor and a link that turn in opposite directions, or a motor that turns less than the link."""
    sides = [
        [f"{side}_{kind}" for kind in KINDS if _shows_motion(recording, f"{side}_{kind}")] for side in ("motor", "link")
    ]
    if not all(sides):
        return
    motor, link = sides[0][0], sides[1][0]
    (time, turned), (when, moved) = way(recording, motor), way(recording, link)
    turned, names = np.interp(when, time, turned), tuple(name for some in sides for name in some)
    together, ratio = np.corrcoef(turned, moved)[0, 1], float(np.std(turned) / np.std(moved))
    if abs(together) > -OPPOSITE and ratio < LEAST_RATIO:
        yield Finding(
            f"{motor} turns {ratio:.2g} times as far as {link}, and a gear makes the link slower: exchange the columns "
            "of motor and link (--map), or mend their units",
            names,
            fatal=True,
        )
    if together < OPPOSITE:
        yield Finding(
            f"{motor} and {link} turn in opposite directions: reverse the sign of one side in all its channels, as "
            f"--map {link}=-1*COLUMN, and that of the drive with the motor's",
            names,
        )


def _shows_motion(recording: Recording, name: str) -> bool:
    return recording.measured(name) and goes(name, recording[name])
