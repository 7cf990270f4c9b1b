"""Channels that stay at one value while the joint moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.sides import MOTION, turns_beside
from joint_id_core.checking.signals import joint_moves, known, moves
from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import derivative_of, integral_of, side_of

BACK = 0.2  # of the span of a position
DRIVES = ("current", "torque", "voltage")


def constant_channels(recording: Recording) -> Iterator[Finding]:
    """Find drives and sensors that do not change while the joint moves."""
    still = [n for n in recording.channels if recording.measured(n) and float(np.ptp(known(recording[n]))) == 0.0]
    if not still or not joint_moves(recording):
        return
    for name in still:
        value = float(known(recording[name])[0]) + 0.0  # no -0
        if name in DRIVES and value == 0.0:
            yield Finding(
                f"Channel {name} is zero in all samples while the joint moves: no inertia and no friction "
                "follows from that; record it, or map the right column to it (--map)",
                (name,),
                fatal=True,
            )
        elif name in ("current", "torque") and _reverses(recording):
            yield Finding(
                f"Channel {name} is {value:.4g} in all samples while the joint moves to and fro: check its column",
                (name,),
            )
        elif name not in DRIVES:
            beside = [n for n in (derivative_of(name), integral_of(name)) if n and recording.measured(n)]
            moving = [n for n in beside if moves(recording[n])]
            if name in ("link_position", "motor_position"):
                others = (n for n in MOTION if side_of(n) != side_of(name) and recording.measured(n))
                moving += [n for n in others if turns_beside(recording, name, n, 0, len(recording))]
            if moving:
                yield Finding(
                    f"Channel {name} is {value:.4g} in all samples while {moving[0]} changes: check the sensor, or "
                    "leave this channel out",
                    (name,),
                    fatal=True,
                )


def _reverses(recording: Recording) -> bool:
    """Return whether a position goes back by a good part of its way."""
    for name in ("link_position", "motor_position"):
        if recording.measured(name):
            x = known(recording[name])
            back = float(np.max(np.maximum.accumulate(x) - x)), float(np.max(x - np.minimum.accumulate(x)))
            return min(back) > BACK * float(np.ptp(x))
    return False
