"""Samples that repeat the one before while the joint moves on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import REMOVE, SAMPLES, Finding, number, places
from joint_id_core.checking.signals import joint_moves, noise
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import BESIDE

JUMP = 0.5  # of the way that the joint should have gone meanwhile, which it goes after a repeated sample
LONG = 3  # repeated values of a velocity that are no chance; noise may repeat one
STEPS = 8.0  # of the noise or resolution, by which that jump exceeds a usual step: less may be chance
REACH = 4  # samples from which the usual steps are taken


def repeated(recording: Recording) -> Iterator[Finding]:
    """Find samples of a position or velocity that repeat the one before, and jump afterwards.

    Where a joint stops, there is no jump. Drives are left out: a controller may hold them.
    """
    if not joint_moves(recording):
        return
    names = [n for n in recording.channels if recording.measured(n) and n not in BESIDE]
    every = np.all([recording[n][1:] == recording[n][:-1] for n in names], axis=0) if len(names) > 1 else None
    found = {}
    for name in names:
        if not name.endswith(("_position", "_velocity")):
            continue
        at, length = late_steps(recording.time, recording[name])
        if len(at) and every is not None and every[at - 1].all():
            yield Finding(
                f"All channels repeat the sample before {number(len(at), 'time')} while the joint moves: from "
                f"{places(recording, at)}; remove these samples, a gap does no harm",
                tuple(names),
                about=SAMPLES,
            )
            return
        found[name] = at[length >= LONG] if name.endswith("_velocity") else at
    for name, at in found.items():
        if len(at):
            yield Finding(
                f"Channel {name} repeats the value before {number(len(at), 'time')} while the joint moves: from "
                f"{places(recording, at)}; {REMOVE}",
                (name,),
                about=SAMPLES,
            )


def late_steps(time: Array, x: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first repeated sample of each run of equal values (T,) after which the signal makes up for its rest.

    The second array has the numbers of repeated samples.
    """
    same = x[1:] == x[:-1]
    if not same.any():
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int))).reshape(-1, 2)
    begin, end = edges[(edges[:, 0] >= REACH) & (edges[:, 1] + 1 + REACH < len(x))].T  # x[begin] to x[end] are equal
    before = (x[begin] - x[begin - REACH]) / (time[begin] - time[begin - REACH])
    after = (x[end + 1 + REACH] - x[end + 1]) / (time[end + 1 + REACH] - time[end + 1])
    slope = 0.5 * (before + after)
    jump, way = x[end + 1] - x[end], slope * (time[end + 1] - time[begin])
    steps = np.abs(x[1:] - x[:-1])
    least = STEPS * max(noise(x), float(np.min(steps, where=steps > 0.0, initial=np.inf)))
    more = np.abs(jump) - np.abs(slope * (time[end + 1] - time[end]))  # than a usual step
    sudden = (before * after > 0.0) & (jump * way > 0.0) & (more > least)
    sudden &= np.abs(jump) > JUMP * np.abs(way)
    return begin[sudden] + 1, (end - begin)[sudden]
