"""Whether motor and link turn the same way, and the motor not less: the gear ratio of all models is positive."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.sides import way
from joint_id_core.checking.signals import goes
from joint_id_core.data.recording import Recording

OPPOSITE = -0.9  # correlation of both ways; a twist is small beside them, an offset of a velocity leaves none
LEAST_RATIO = 0.5  # of motor over link: gears of robots make the link slower
KINDS = ("position", "velocity")
VELOCITIES = ("motor_velocity", "link_velocity")


def directions(recording: Recording) -> Iterator[Finding]:
    """Find a motor and a link that turn in opposite directions, or a motor that turns less than the link."""
    if (found := _exchanged_velocities(recording)) is not None:
        yield found
        return
    sides = [
        [f"{side}_{kind}" for kind in KINDS if _shows_motion(recording, f"{side}_{kind}")] for side in ("motor", "link")
    ]
    if not all(sides):
        return
    motor, link = sides[0][0], sides[1][0]
    names = tuple(name for some in sides for name in some)
    together, ratio = _compared(recording, motor, link)
    if abs(together) > -OPPOSITE and ratio < LEAST_RATIO:
        yield _exchanged(motor, link, ratio, names)
    if together < OPPOSITE:
        yield Finding(
            f"{motor} and {link} turn in opposite directions: reverse the sign of one side in all its channels, as "
            f"--map {link}=-1*COLUMN, and that of the drive with the motor's",
            names,
        )


def motor_beside_link(recording: Recording) -> float:
    """Return how many times as far as the link the motor turns, by their positions; infinity if they do not show it."""
    motor, link = "motor_position", "link_position"
    if not (_shows_motion(recording, motor) and _shows_motion(recording, link)):
        return math.inf
    together, ratio = _compared(recording, motor, link)
    return ratio if abs(together) > -OPPOSITE else math.inf


def _exchanged_velocities(recording: Recording) -> Finding | None:
    """Return that the velocities of motor and link are exchanged: each as slow, or as fast, as those of the other."""
    motor, link = VELOCITIES
    if not all(recording.measured(name) for name in VELOCITIES):
        return None
    if not (goes(link, recording[motor]) and goes(motor, recording[link])):
        return None
    together, ratio = _compared(recording, motor, link)
    exchanged = abs(together) > -OPPOSITE and ratio < LEAST_RATIO
    return _exchanged(motor, link, ratio, VELOCITIES) if exchanged else None


def _compared(recording: Recording, motor: str, link: str) -> tuple[float, float]:
    """Return the correlation of the ways of motor and link, and how many times as far the motor turns."""
    (time, turned), (when, moved) = way(recording, motor), way(recording, link)
    turned = np.interp(when, time, turned)
    return float(np.corrcoef(turned, moved)[0, 1]), float(np.std(turned) / np.std(moved))


def _exchanged(motor: str, link: str, ratio: float, names: tuple[str, ...]) -> Finding:
    return Finding(
        f"{motor} turns {ratio:.2g} times as far as {link}, and a gear makes the link slower: exchange the columns of "
        "motor and link (--map), or mend their units",
        names,
        fatal=True,
    )


def _shows_motion(recording: Recording, name: str) -> bool:
    return recording.measured(name) and goes(name, recording[name])
