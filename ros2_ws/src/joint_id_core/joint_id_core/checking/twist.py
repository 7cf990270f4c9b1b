"""Motor and link encoders with different zeros, or that drift apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.sides import TWIST
from joint_id_core.checking.signals import goes
from joint_id_core.data.recording import Array, Recording

RATIO = 10.0  # a smaller ratio is no gear with a twist
LEAST = 0.005  # rad at the link, of what is constant
LEAST_DRIFT = 0.01  # rad at the link, over the recording
CHANCE = 5.0  # standard deviations of what varies
OWN_COURSE = 0.5  # share of the motion that is not a steady one; with less, a drift cannot be told from it
ROWS = 2000  # instants that are compared at most
NAMES = ("motor_position", "link_position")


def twist_offset(recording: Recording) -> Iterator[Finding]:
    """Find a twist between motor and link that is mostly a constant, or that grows with time."""
    if not all(recording.measured(n) and goes(n, recording[n]) for n in NAMES):
        return
    seen = np.all([np.isfinite(recording[n]) for n in NAMES], axis=0)
    half = 0.5 * np.count_nonzero(seen)  # the drive may be known at other instants
    drives = [n for n in ("torque", "current") if n in recording and np.isfinite(recording[n][seen]).sum() > half][:1]
    rows = [recording[n] for n in (*NAMES, *drives)]
    known = np.flatnonzero(np.all(np.isfinite(rows), axis=0))
    known = known[:: max(1, len(known) // ROWS)]
    if len(known) < 3:
        return
    motor, link, *load = (row[known] for row in rows)
    middle = float(link.mean())
    spread = link - middle
    ratio = float(spread @ motor) / float(spread @ spread)
    if abs(ratio) < RATIO:
        return
    left = motor / ratio - link
    time = recording.time[known]
    drift = _drift(time, left, [spread, *load])
    offset = float(left.mean())
    # The ratio is not known better than the twist allows.
    unsure = float(np.std(left)) / float(np.std(spread)) * abs(middle)
    if drift:
        yield Finding(
            f"Motor and link angle, beside the gear ratio of {ratio:.5g}, drift apart by {drift:.2g} rad at the link "
            f"in {time[-1] - time[0]:.4g} s: a coupling slips, or an encoder does; mend it, or fit a short part "
            "(--start, --end)",
            NAMES,
            about="drift",
        )
    elif abs(offset) > _largest_twist(left, load) + CHANCE * unsure:
        yield Finding(
            f"Motor and link angle differ by {offset:.4g} rad throughout, beside the gear ratio of {ratio:.5g}: their "
            "encoders have different zeros; subtract this, or take a model with an offset of the twist (dtheta_0)",
            NAMES,
            about="twist",
        )


def _largest_twist(left: Array, load: Sequence[Array]) -> float:
    """Return the largest constant part that a twist (T,) may have in rad, under the load of the drive if that is known.

    A spring has a constant part of the twist as large, against what varies, as that of its load.
    """
    if not load or float(np.std(load[0])) == 0.0:
        return TWIST
    constant = abs(float(np.mean(load[0]))) / float(np.std(load[0]))
    return min(TWIST, LEAST + CHANCE * float(np.std(left)) * (1.0 + constant))


def _drift(time: Array, left: Array, others: Sequence[Array]) -> float:
    """Return by how much a twist (T,) grows with time in rad, beside what goes with others; 0 if that may be chance."""
    course = (time - time.mean()) / (time[-1] - time[0])
    columns = [np.ones(len(time)), *others, course]
    motion = others[0]
    if np.var(motion - np.polyval(np.polyfit(course, motion, 1), course)) < OWN_COURSE * np.var(motion):
        return 0.0
    scaled = np.column_stack([column / (np.abs(column).max() or 1.0) for column in columns])
    found = np.linalg.lstsq(scaled, left, rcond=None)[0]
    drift = float(found[-1]) / float(np.abs(course).max())
    rest = float(np.std(left - scaled @ found))
    return drift if abs(drift) > LEAST_DRIFT + CHANCE * rest else 0.0
