"""Quantities that are not in SI units: times in milliseconds, positions in counts or degrees, torques in mNm.

Also values that no joint has.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from joint_id_core.checking.direction import motor_beside_link
from joint_id_core.checking.finding import REMOVE, SAMPLES, Finding, number, places
from joint_id_core.checking.swapped import drive_as_position
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS, LARGEST

SLOWEST_S = 0.5  # a longer period shows no motion of a joint
# Units of time, each with the longest period that is taken for it: those between are 0.1 s in one, 0.1 ms in the next.
TIMES = (("milliseconds", "0.001", 100.0), ("microseconds", "1e-6", 1e5), ("nanoseconds", "1e-9", SLOWEST_S * 1e9))
DISTINCT = 50  # whole numbers among positions that are no chance
# By drive, what no joint of a robot has at its link, its unit, and whether more is an error for sure: other machines
# have stronger gears, but no motor of a joint takes so many amperes.
STRONGEST = {"torque": (5e4, "Nm", False), "current": (1e3, "A", True)}
TURNS = 4.0 * 2.0 * np.pi  # rad that no link of a robot turns
GEARED = 0.1  # of motor over link, from which they are exchanged: beside a link in degrees it is a 57th of the gear's
FAST, OVER_S = 12.0, 0.1  # rad/s that no link of a robot has over such a time; those of a cobot reach 3 to 6


def too_large(recording: Recording) -> Iterator[Finding]:
    """Find values that no joint reaches; what is computed of them may be beyond all numbers."""
    for name, values in recording.channels.items():
        at = np.flatnonzero(np.abs(values) > LARGEST)
        if len(at):
            yield Finding(
                f"Channel {name} has {number(len(at), 'value')} beyond {LARGEST:g} {CHANNELS[name].unit}, which no "
                f"joint reaches: {places(recording, at)}; if its unit is another one, convert it (--map), else "
                f"{REMOVE}",
                (name,),
                fatal=True,
                about=SAMPLES,
                samples=tuple(at.tolist()),
            )


def time_units(recording: Recording) -> Iterator[Finding]:
    """Find times that are not in seconds."""
    period = recording.period
    if period > SLOWEST_S:
        seems = next((one for one in TIMES if period <= one[2]), None)
        mend = "check its column" if seems is None else (
            f"time seems to be in {seems[0]}; convert it to s (--map time_s={seems[1]}*COLUMN)"
        )  # fmt: skip
        yield Finding(
            f"The samples are {period:.4g} s apart, which is too long for the motion of a joint: {mend}", fatal=True
        )


def position_units(recording: Recording) -> Iterator[Finding]:
    """Find positions that are no radians, by their values alone."""
    for name in ("motor_position", "link_position"):
        if not recording.measured(name):
            continue
        known = recording[name][np.isfinite(recording[name])]
        if _whole(known):
            yield Finding(
                f"All values of {name} are whole numbers: these are encoder counts, no rad; multiply them by 2 pi over "
                f"the counts of a turn (--map {name}=FACTOR*COLUMN)",
                (name,),
                fatal=True,
            )
        elif name == "link_position" and (span := float(np.ptp(known))) > TURNS:
            fast = not recording.measured("link_velocity") and _speed(recording, name) > FAST
            if fast and (motor_beside_link(recording) < GEARED or drive_as_position(recording)):
                continue  # it is another signal, which is told by the checks of these
            seems = "it is in degrees" if fast else "if it is in degrees"
            yield Finding(
                f"Channel {name} spans {span:.4g} rad, more than the link of a robot turns: {seems}; multiply it by "
                f"0.0174533 (--map {name}=0.0174533*COLUMN)",
                (name,),
                fatal=fast,
            )


def drive_units(recording: Recording) -> Iterator[Finding]:
    """Find drives that are larger than those of any robot; of a rigid joint, no motion shows their unit."""
    for name, (most, unit, sure) in STRONGEST.items():
        if recording.measured(name) and (largest := float(np.nanmax(np.abs(recording[name])))) > most:
            yield Finding(
                f"Channel {name} seems to be in m{unit}: it reaches {largest:.3g} {unit}, more than joints of robots "
                f"have; multiply it by 0.001 (--map {name}=0.001*COLUMN)",
                (name,),
                fatal=sure,
            )


def _speed(recording: Recording, name: str) -> float:
    """Return the largest change of a position in `OVER_S`, in rad/s."""
    step = max(1, round(OVER_S / recording.period))
    values = recording[name]
    moved = np.abs(values[step:] - values[:-step])
    return float(np.nanmax(moved, initial=0.0)) / (step * recording.period)


def _whole(known: Array) -> bool:
    """Return whether values (T,) are whole numbers, and too many of them for it to be chance."""
    return len(known) > 0 and bool(np.all(known == np.rint(known))) and len(np.unique(known)) >= DISTINCT
