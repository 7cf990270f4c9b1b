"""Joints that do not change, watched for a long time: errors beside sigma, and changes that are none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.results.estimate import Status
from online.joints import joint
from online.records import steady
from online.watching import watch

AT_S = (20.0, 120.0, 600.0)  # time of motion at which estimates are compared with the truth
INTERVAL = 1.959964  # standard deviations: 95 %


@dataclass(frozen=True)
class LongRun:
    """One joint that was watched without a change.

    Attributes:
        model, motion, seed: which one.
        seconds: how long.
        off: error over sigma of every estimated parameter, by time in s.
        alarms: instants at which a change was named, or all that was known was forgotten, in s.
        not_converged: share of the estimates that say that they did not converge; rests do not count.
        largest, worst: largest error over sigma of a converged estimate, and its parameter.
    """

    model: str
    motion: str
    seed: int
    seconds: float
    off: Mapping[float, Mapping[str, float]]
    alarms: tuple[float, ...]
    not_converged: float
    largest: float
    worst: str


def long_run(model: str, motion: str, seed: int, seconds: float) -> LongRun:
    """Watch a joint that does not change."""
    it = joint(model)
    hops = [h for h in watch(it, steady(it, motion, seed, seconds)) if h.status != Status.TOO_SHORT.value]
    moving = [h for h in hops if not h.rests]
    off = {}
    for at in AT_S:
        near = [h for h in moving if h.converged and at - 2.0 < h.end < at + 0.5]
        if near and at <= seconds:
            off[at] = near[-1].off
    alarms = {t for h in hops for t in h.named} | {h.end for h in hops if h.forgot}
    worst = max(moving, key=lambda h: h.largest)
    return LongRun(
        model, motion, seed, seconds, off, tuple(sorted(alarms)), float(np.mean([not h.converged for h in moving])),
        worst.largest, worst.worst,
    )  # fmt: skip


@dataclass(frozen=True)
class Honesty:
    """Errors over sigma of many joints after the same time: smallest and largest over the parameters.

    Attributes:
        joints: how many.
        ratio: rms error over sigma.
        coverage: share of 95 % intervals that hold the truth, of each parameter.
        mean: the same share, of all parameters together.
        worst: parameter with the largest ratio.
    """

    joints: int
    ratio: tuple[float, float]
    coverage: tuple[float, float]
    mean: float
    worst: str


def honesty(runs: Sequence[LongRun], at: float) -> Honesty | None:
    """Statistics over joints at a time; None if no joint was watched for so long."""
    rows = [run.off[at] for run in runs if at in run.off]
    if not rows:
        return None
    names = sorted({name for row in rows for name in row})
    off = {name: np.array([row[name] for row in rows if name in row]) for name in names}
    ratio = {name: float(np.sqrt(np.mean(z**2))) for name, z in off.items()}
    holds = {name: float(np.mean(np.abs(z) < INTERVAL)) for name, z in off.items()}
    return Honesty(
        len(rows), (min(ratio.values()), max(ratio.values())), (min(holds.values()), max(holds.values())),
        float(np.mean(np.abs(np.concatenate(list(off.values()))) < INTERVAL)), max(ratio, key=lambda n: ratio[n]),
    )  # fmt: skip
