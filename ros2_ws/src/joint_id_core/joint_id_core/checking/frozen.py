"""Encoders and velocities that froze: they stand still while another signal shows that the joint moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.clipping import LONG, long_runs, varies_else
from joint_id_core.checking.finding import SAMPLES, Finding, stretches
from joint_id_core.checking.jumps import sudden
from joint_id_core.checking.repeats import late_steps
from joint_id_core.checking.sides import MOTION, turns_beside, way
from joint_id_core.checking.signals import joint_moves, known, noise
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import side_of

# Share of the span of a speed, by which it changes while a velocity stands still: of one that else changes with every
# sample, and of any other.
CHANGED, CHANGED_COARSE = 0.03, 0.2
STEPS = 3.0  # of the resolution of a velocity; less it does not show
CHANCE = 12.0  # standard deviations of noise
# A drive alone tells of motion if it does more than where the joint moved: friction holds a joint only against less.
STRETCH = 0.1  # of the samples
WORKS = 0.8  # of its root mean square elsewhere
REACHES = 0.95  # of how far it goes elsewhere, to both sides
ENDS = (1.0, 99.0)  # percentiles; a drive may begin with a jump


def frozen(recording: Recording) -> Iterator[Finding]:
    """Find stretches in which a position or velocity stands still while another signal shows motion."""
    if not joint_moves(recording):
        return
    for name in (n for n in MOTION if recording.measured(n)):
        at = np.flatnonzero(np.isfinite(recording[name]))
        long = _unnamed_runs(recording.time[at], recording[name][at], name.endswith("_position"))
        seen = {(first, last): _witness(recording, name, first, last + 1) for first, last in at[long].tolist()}
        stood = {ends: witness for ends, witness in seen.items() if witness}
        if stood:
            witness = next(iter(stood.values()))
            why = "the sensor froze" + ("" if witness in MOTION else ", or the joint was blocked")
            yield Finding(
                f"Channel {name} stands still in samples {stretches(recording, list(stood))} while "
                f"{witness} shows motion: {why}; remove these samples",
                (name,),
                about=SAMPLES,
            )


def _unnamed_runs(time: Array, x: Array, is_position: bool) -> NDArray[np.int64]:
    """Return first and last sample of the long runs of equal values (T,) that no other check names."""
    runs = long_runs(x)
    first, last = runs.T
    inside = (first > 0) & (last < len(x) - 1)
    begin, length = late_steps(time, x)  # see `repeats`
    alike = x[np.maximum(first - 1, 0)] * x[np.minimum(last + 1, len(x) - 1)] > 0.0
    named = np.isin(last, begin - 1 + length) | (inside & (x[first] == 0.0) & alike)  # see `rows.zeros`
    if is_position:
        named |= np.isin(last, sudden(time, x))  # see `jumps`
    return runs[(last - first < len(x) - 1) & ~named]


def _witness(recording: Recording, name: str, first: int, last: int) -> str:
    """Return the name of a channel that shows motion in the samples `first` to before `last`; "" if none does."""
    others = [n for n in MOTION if n != name and recording.measured(n)]
    others.sort(key=lambda n: side_of(n) != side_of(name))
    shows = turns_beside if name.endswith("_position") else _differs_in_speed
    if others:
        return next((n for n in others if shows(recording, name, n, first, last)), "")
    drive = next((n for n in ("torque", "current") if recording.measured(n)), "")
    return drive if drive and _works(recording, name, recording[drive], first, last) else ""


def _differs_in_speed(recording: Recording, still: str, other: str, first: int, last: int) -> bool:
    """Return whether `other` changes its speed while the velocity `still` is constant."""
    time, x = way(recording, other)
    if len(time) <= 2 * LONG:
        return False
    width = time[LONG:] - time[:-LONG]
    speed = (x[LONG:] - x[:-LONG]) / width
    begin, end = np.searchsorted(time, recording.time[[first, last - 1]])
    meanwhile = speed[begin : max(begin, end - LONG)]
    if len(meanwhile) < 2:
        return False
    velocity = known(recording[still])
    steps = np.abs(np.diff(velocity))
    resolution = float(np.min(steps, where=steps > 0.0, initial=np.inf)) / float(np.ptp(velocity))
    share = CHANGED if varies_else(velocity, long_runs(velocity)) else CHANGED_COARSE
    least = float(np.ptp(speed)) * max(share, STEPS * resolution)
    if other.endswith("_position"):
        least += CHANCE * noise(x) / float(np.median(width))
    return float(np.ptp(meanwhile)) > least


def _works(recording: Recording, still: str, drive: Array, first: int, last: int) -> bool:
    """Return whether a drive (T,) moves the joint in the samples `first` to before `last`, as far as it alone tells."""
    ends = max(LONG // 2, (last - first) // 20)  # near these a joint that rested begins to move
    meanwhile = known(drive[first + ends : last - ends])
    outside = known(np.concatenate([drive[:first], drive[last:]]))
    if len(meanwhile) < 2 or len(outside) < 2:
        return False
    x = known(recording[still])
    if not varies_else(x, long_runs(x)):
        return False
    if still.endswith("_velocity") and recording[still][first] != 0.0:  # it does not stay the same under another drive
        return float(np.ptp(meanwhile)) > CHANGED_COARSE * float(np.ptp(outside))
    meanwhile, outside = meanwhile - outside.mean(), outside - outside.mean()
    (low, high), (least, most) = (np.percentile(part, ENDS) for part in (meanwhile, outside))
    return bool(
        len(meanwhile) > STRETCH * len(drive)
        and float(np.sqrt(np.mean(meanwhile**2))) > WORKS * float(np.std(outside))
        and high > REACHES * most
        and low < REACHES * least
    )
