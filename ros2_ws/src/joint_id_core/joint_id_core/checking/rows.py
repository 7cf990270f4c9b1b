"""Values that are not those of the joint: outliers, and zeros in place of values."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.constant import DRIVES
from joint_id_core.checking.finding import REMOVE, SAMPLES, Finding, number, places
from joint_id_core.checking.signals import MAD, SECOND, joint_moves, noise
from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import BESIDE, CHANNELS

FAR = 12.0  # standard deviations of the noise between an outlier and the course of its neighbours
LEAST_SHARE = 0.01  # of the span between the 5th and 95th percentile; less does no harm
HARMLESS = 1e-4  # of the typical size of a channel; the same
OUTSIDE = 0.25  # of this span, by which an outlier of a drive lies out of it: a controller may send a short pulse
AGREE = 0.25  # difference of the neighbours of an outlier, over its distance from their middle
ALONE = 0.15  # distance of these neighbours from a line through those beyond them, over the same
AROUND = 12  # samples to either side whose noise counts
MOST_SHARE = 0.02  # of all samples; more is the nature of the signal


def outliers(recording: Recording) -> Iterator[Finding]:
    """Find single samples far off the course of their neighbours, in a joint that moves."""
    if not joint_moves(recording):
        return
    for name in recording.channels:
        if recording.measured(name) and name not in BESIDE:
            known = np.flatnonzero(np.isfinite(recording[name]))
            if len(known) < 4 * AROUND:
                continue
            smallest, may_jump = HARMLESS * CHANNELS[name].scale, name in (*DRIVES, "external_torque")
            at = known[_spikes(recording[name][known], smallest, may_jump)]
            if len(at):
                yield Finding(
                    f"Channel {name} has {number(len(at), 'outlier')}, far off the samples around: "
                    f"{places(recording, at)}; {REMOVE}",
                    (name,),
                    about=SAMPLES,
                    samples=tuple(at.tolist()),
                )


def _spikes(x: Array, smallest: float, may_jump: bool) -> NDArray[np.int64]:
    """Return the samples that alone are far off a line through their neighbours, by `smallest` at least.

    A drive or a load may jump, and come back: it has outliers only where it is not constant, and far out of its usual
    range.
    """
    off = np.zeros(len(x))
    off[1:-1] = x[1:-1] - 0.5 * (x[2:] + x[:-2])
    low, high = np.percentile(x, [5.0, 95.0])
    least = max(FAR * noise(x) * SECOND / 2.0, LEAST_SHARE * float(high - low), smallest)
    found = np.flatnonzero(np.abs(off) > least)
    found = found[(found > 1) & (found < len(x) - 2)]
    if may_jump:
        found = found[(x[found] < low - OUTSIDE * (high - low)) | (x[found] > high + OUTSIDE * (high - low))]
    # Beside an outlier the two neighbours agree with each other; beside a jump they do not.
    found = found[np.abs(x[found + 1] - x[found - 1]) < AGREE * np.abs(off[found])]
    if not len(found) or len(found) > max(3, MOST_SHARE * len(x)):
        return found[:0]
    kept = []
    for k in found.tolist():
        begin, end = max(1, k - AROUND), min(len(x) - 1, k + AROUND + 1)
        near = np.abs(np.concatenate([off[begin : k - 1], off[k + 2 : end]]))
        size = MAD * float(np.median(near))
        # The neighbours lie on the course of those beyond them: else it is a short pulse, no single sample.
        slope = (x[k + 2] - x[k - 2]) / 4.0
        beside = max(abs(x[k - 1] - x[k - 2] - slope), abs(x[k + 1] - x[k + 2] + slope))
        if abs(off[k]) > FAR * size and beside < ALONE * abs(off[k]) + 2.5 * size and (size > 0.0 or not may_jump):
            kept.append(k)
    return np.array(kept, dtype=np.int64)


def zeros(recording: Recording) -> Iterator[Finding]:
    """Find runs of exact zeros of a position or velocity between values that are far from zero."""
    for name in recording.channels:
        if not name.endswith(("_position", "_velocity")) or not recording.measured(name):
            continue
        known = np.flatnonzero(np.isfinite(recording[name]))
        x = recording[name][known]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], x == 0.0, [False]]).astype(int))).reshape(-1, 2)
        inner = edges[(edges[:, 0] > 0) & (edges[:, 1] < len(x)) & (edges[:, 1] - edges[:, 0] > 1)]
        if not len(inner):
            continue
        before, after = x[inner[:, 0] - 1], x[inner[:, 1]]
        usual = max(FAR * noise(x), 5.0 * float(np.percentile(np.abs(x[1:] - x[:-1]), 99.0)))
        sudden = (np.minimum(np.abs(before), np.abs(after)) > usual) & (before * after > 0.0)
        if sudden.any():
            at = known[inner[sudden, 0]]
            yield Finding(
                f"Channel {name} jumps to zero and back {number(len(at), 'time')}: from {places(recording, at)}; "
                f"{REMOVE}",
                (name,),
                about=SAMPLES,
                samples=tuple(at.tolist()),
            )
