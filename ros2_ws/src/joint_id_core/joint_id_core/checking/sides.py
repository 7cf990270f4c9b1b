"""How far the shafts on both sides of the gear turn."""

from __future__ import annotations

import numpy as np

from joint_id_core.checking.signals import known
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import side_of

TWIST = 0.02  # rad at the link: no gear of a robot twists so far
LARGEST_RATIO = 400.0  # of gears of robots
MOTION = ("link_position", "motor_position", "link_velocity", "motor_velocity")
MOVED = 0.1  # of its whole way, from which a shaft goes somewhere
QUICK = 95.0  # percentile of the size of a velocity


def way(recording: Recording, name: str) -> tuple[Array, Array]:
    """Return times (T,) and the way (T,) of a position or a velocity at them; missing values are left out."""
    seen = np.isfinite(recording[name])
    time, x = recording.time[seen], recording[name][seen]
    if name.endswith("_position"):
        return time, x
    return time, np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(time))])


def turns_beside(recording: Recording, still: str, other: str, first: int, last: int) -> bool:
    """Return whether `other` shows that its shaft turns in the samples `first` to before `last`.

    The position `still` stands meanwhile. If it is on the other side of the gear, the way has to be longer than any
    twist.
    """
    time, x = way(recording, other)
    begin, end = np.searchsorted(time, recording.time[[first, last - 1]])
    if end - begin < 2:
        return False
    span = float(np.ptp(x[begin : end + 1]))
    least = MOVED * float(np.ptp(x))
    if side_of(still) != side_of(other):
        least = max(least, TWIST * (LARGEST_RATIO if side_of(other) == "motor" else 1.0))
    if other.endswith("_velocity"):  # an offset of a velocity makes a way, too
        meanwhile = known(recording[other][first:last])
        quick = np.percentile(np.abs(known(recording[other])), QUICK)
        if np.percentile(np.abs(meanwhile), QUICK) < MOVED * quick:
            return False
    return span > least
