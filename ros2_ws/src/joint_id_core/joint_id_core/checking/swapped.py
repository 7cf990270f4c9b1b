"""A drive in the column of a motion: motion changes as the drive moves it (paper Eq 9)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.data.recording import Array, Recording

DRIVES, VELOCITY, LINK = ("current", "torque"), "motor_velocity", "link_position"
POSITIONS = (LINK, "motor_position")
EXCHANGE = "are these two columns swapped? Then exchange them (--map)"
BLOCK = 5  # samples whose means are compared: noise of one sample is no change
LEAST = 50  # blocks; fewer tell nothing
# Shares of the variance of the changes that are explained. The second is at most 0.47 in recordings of a UR3e, a UR10e
# and EMPS. Exchanged, simulated motors have 0.1 to 0.25 and 0.97 to 0.99.
FOLLOWS, IGNORES = 0.95, 0.3


def swapped(recording: Recording) -> Iterator[Finding]:
    """Find a drive and the motion that it makes in each other's columns."""
    if drive := drive_as_position(recording):
        yield Finding(f"{drive} moves as {LINK} drives it: {EXCHANGE}", (drive, LINK), fatal=True)
    elif drive := _drive_as_velocity(recording):
        yield Finding(
            f"{drive} changes as {VELOCITY} drives it, and {VELOCITY} does not change with {drive}: {EXCHANGE}",
            (drive, VELOCITY),
        )


def _drive_as_velocity(recording: Recording) -> str:
    """Return the drive that is the velocity of the motor, which is in its column; "" if none is.

    A current that holds a spring or a weight changes as the velocity says, too. So a position, where one is measured,
    must move as the drive says rather than as the velocity does.
    """
    drive = next((d for d in DRIVES if recording.measured(d)), None)
    if drive is None or not recording.measured(VELOCITY):
        return ""
    i, w = _means(recording[drive]), _means(recording[VELOCITY])
    moved = [_means(recording[p]) for p in POSITIONS if recording.measured(p)]
    if any(_explained(np.diff(q), [_middle(w)]) > _explained(np.diff(q), [_middle(i)]) for q in moved):
        return ""
    return drive if _driven(w, i) < IGNORES and _driven(i, w) > FOLLOWS else ""


def drive_as_position(recording: Recording) -> str:
    """Return the drive that is the position of the link, which is in its column; "" if none is.

    In a motion of one frequency each is the other's acceleration: nothing is told then.
    """
    if not recording.measured(LINK):
        return ""
    force = _means(recording[LINK])
    for drive in filter(recording.measured, DRIVES):
        angle = _means(recording[drive])
        if _moved_by(angle, force) > FOLLOWS and _moved_by(force, angle) < IGNORES:
            return drive
    return ""


def _moved_by(angle: Array, force: Array) -> float:
    """Return the share of the variance of a force that acceleration, velocity and friction of an angle explain."""
    velocity = angle[2:] - angle[:-2]
    return _explained(force[1:-1], [np.diff(angle, 2), velocity, np.sign(velocity)])


def _means(values: Array) -> Array:
    """Return the means of blocks."""
    count = len(values) // BLOCK
    return np.asarray(values[: count * BLOCK].reshape(count, BLOCK).mean(axis=1))


def _middle(values: Array) -> Array:
    """Return the means of two blocks that follow each other."""
    return np.asarray(0.5 * (values[1:] + values[:-1]))


def _driven(x: Array, u: Array) -> float:
    """Return the share of the variance of the changes of x that a drive u and friction of x explain."""
    return _explained(np.diff(x), [_middle(u), _middle(x), np.sign(_middle(x))])


def _explained(change: Array, by: Sequence[Array]) -> float:
    """Return the share of the variance of some values (n,) that other quantities (n,) explain."""
    rows = np.column_stack([*by, np.ones(len(change)), change])
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < LEAST:
        return 0.0
    rows = rows / np.maximum(np.abs(rows).max(axis=0), np.finfo(float).tiny)
    y, variance = rows[:, -1], float(np.var(rows[:, -1]))
    left = y - rows[:, :-1] @ np.linalg.lstsq(rows[:, :-1], y, rcond=None)[0]
    return 1.0 - float(np.var(left)) / variance if variance > 0.0 else 0.0
