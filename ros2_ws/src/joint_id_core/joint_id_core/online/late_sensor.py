"""Whether a sensor is late: samples that the joint as it was explains, once one label is shifted in time.

A delay can pass for a change of the joint. A twist that lags behind the motion looks like damping, so other parameters
may describe the samples well, tens of standard deviations off. But it often takes all of them, and a delay is one
number. So a delay is tried beside every change (isolation of a fault by hypotheses of its cause: Basseville &
Nikiforov, Detection of Abrupt Changes, 1993, ch. 7). A sensor that becomes late does so by whole samples, so a shorter
delay is none: half a millisecond of the link's position is what a gear that is softer by a tenth looks like.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # whose parts load when used
from scipy.special import chdtri

from joint_id_core.data.recording import Array
from joint_id_core.online.memory import RARE
from joint_id_core.online.piece import Piece, Samples, joined
from joint_id_core.online.relearn import Learned, relearn
from joint_id_core.online.tracker import Tracker

LATEST = 0.02  # s, bound of a delay, as of those that a model can have
SPREAD = 0.005  # s, standard deviation of a delay before the samples are seen, likewise
TRIED = 1e-3  # s, step of the search
STEPS = 5  # of the search, at most
SMOOTH = 21  # samples over which a label is smoothed before its slope is taken


@dataclass(frozen=True)
class Late:
    """A label that is late by `delay` (s), and the fit of the samples when it is shifted back.

    No cost counts the samples at both ends of a motion, whose labels a delay may have taken. `without` are the costs
    without delay at other parameters. `occam` is to be added for the delay, as `Learned.occam` for the parameters.
    """

    label: str
    delay: float
    learned: Learned
    without: tuple[float, ...]
    occam: float

    @property
    def text(self) -> str:
        """The fault in words."""
        how = "late" if self.delay > 0.0 else "early"
        size = f"{1e3 * abs(self.delay):.2g} ms"
        return f"The joint is as it was if {self.label} is {how} by {size}: check this sensor."


def late_sensor(
    tracker: Tracker, stretches: Sequence[Piece], mean: Array, precision: Array, others: Sequence[Array] = ()
) -> Late | None:
    """Return the label whose delay explains samples of a joint with parameters that are known.

    Args:
        tracker: it ends at the end of the stretches.
        stretches: the samples.
        mean, precision: what is known of the parameters, shapes (k,) and (k, k), in estimation coordinates.
        others: parameters (k,) that explain the samples, too.

    Returns:
        The label with the lowest cost; None if no delay explains the samples, or if they need none.
    """
    z, motions = tracker.coordinates.clip(mean), _motions(stretches)
    none = _cost(tracker, _shifted(motions, 0, 0.0), z)
    found = [(*_delay(tracker, motions, z, k, none), k) for k in range(len(tracker.data.labels))]
    cost, delay, bend, k = min(found)
    if not np.isfinite(none) or none - cost < float(chdtri(1, RARE)) or abs(delay) < tracker.data.period:
        return None
    without = tuple(_cost(tracker, _shifted(motions, 0, 0.0), other) for other in others)
    learned = relearn(tracker, _shifted(motions, k, delay), mean, precision, from_mean=True)
    if learned is None or not learned.explained:
        return None
    occam = (delay / SPREAD) ** 2 + math.log(max(1.0, 0.5 * bend * (SPREAD / TRIED) ** 2))
    return Late(tracker.data.labels[k], delay, learned, without, occam)


def _delay(tracker: Tracker, motions: Sequence[Piece], z: Array, label: int, none: float) -> tuple[float, float, float]:
    """Return the lowest cost of the samples, the delay of a label there, in s, and the bend of the cost.

    `none` is the cost without delay. The bend is the second difference of the cost over `TRIED`. Errors grow in
    proportion to the delay that is missed, so the cost is nearly a parabola.
    """
    here, cost, bend = 0.0, none, 0.0
    for _ in range(STEPS):
        before, after = (_cost(tracker, _shifted(motions, label, here + by), z) for by in (-TRIED, TRIED))
        bend = before - 2.0 * cost + after
        if not 0.0 < bend < np.inf:
            break
        there = float(np.clip(here + 0.5 * TRIED * (before - after) / bend, TRIED - LATEST, LATEST - TRIED))
        worth = _cost(tracker, _shifted(motions, label, there), z)
        if not worth < cost:
            break
        moved, here, cost = abs(there - here), there, worth
        if moved < 0.1 * TRIED:
            break
    return cost, here, bend


def _cost(tracker: Tracker, motions: Sequence[Piece], z: Array) -> float:
    passed = tracker.again(motions, z)
    return np.inf if passed is None else float(passed[0].sum())


def _motions(stretches: Sequence[Piece]) -> list[Piece]:
    """Return stretches that follow each other without a rest as one."""
    found: list[list[Piece]] = []
    for piece in stretches:
        if found and piece.begin.time == found[-1][-1].samples.time[-1]:
            found[-1].append(piece)
        else:
            found.append([piece])
    return [replace(pieces[0], samples=joined([piece.samples for piece in pieces])) for pieces in found]


def _shifted(motions: Sequence[Piece], label: int, delay: float) -> list[Piece]:
    """Return motions with a label as it would be without its delay in s, and no labels at their ends."""
    found = []
    for piece in motions:
        start, samples = piece.begin.start, piece.samples
        first = samples if start is None else joined([start[1], samples])
        whole = _without(first, label, delay)
        at = len(whole.time) - len(samples.time)
        parts = whole.split(at)
        begin = piece.begin if start is None else replace(piece.begin, start=(start[0], parts[0]))
        found.append(replace(piece, begin=begin, samples=parts[1]))
    return found


def _without(samples: Samples, label: int, delay: float) -> Samples:
    """Take the motion of a label during the delay from the smoothed label, so that its noise stays as it was."""
    y, time = samples.y.copy(), samples.time
    known = np.flatnonzero(np.isfinite(y[:, label]))
    if delay and len(known) > SMOOTH:
        smooth = scipy.signal.savgol_filter(y[known, label], SMOOTH, 3)
        y[known, label] += np.interp(time[known] + delay, time[known], smooth) - smooth
    y[(time < time[0] + LATEST) | (time > time[-1] - LATEST)] = np.nan
    return replace(samples, y=y)
