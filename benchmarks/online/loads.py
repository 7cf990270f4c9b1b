"""Loads that come and go, as in pick and place: every few seconds the joint holds twice what it holds alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from online.cases import BEFORE_S
from online.joints import Joint, joint
from online.records import Watched, joined, moves, stretch
from online.watching import FAR, watch

EVERY_S = (8.0, 4.0, 2.5)  # mean time between two changes
JITTER = 0.3  # how far each is off at most
CARRIED = 2.0  # inertia with the load over that without
WATCHED_S = 40.0
JOINTS_WITH_LOAD = ("harmonic_drive", "rigid_joint", "electromechanical")


@dataclass(frozen=True)
class Loads:
    """What an identifier said of a joint whose load comes and goes.

    Attributes:
        model, motion, seed, every_s: which one.
        hops: estimates, without those that say that the joint rests.
        right: share of these that are `converged`, with every estimated parameter within 4 sigma of the truth.
        wrong: share that are `converged`, but not right; longest_s: how long at most, without a break.
    """

    model: str
    motion: str
    seed: int
    every_s: float
    hops: int
    right: float
    wrong: float
    longest_s: float


def loads(model: str, motion: str, seed: int, every_s: float) -> Loads:
    """Watch one joint."""
    watched = _record(joint(model), motion, seed, every_s)
    after = [hop for hop in watch(joint(model), watched) if hop.end > watched.since and not hop.rests]
    bad = [hop.converged and hop.largest > FAR for hop in after]
    right = [hop.converged and hop.largest <= FAR for hop in after]
    longest = begun = 0.0
    for hop, wrong in zip(after, bad, strict=True):
        begun = (begun or hop.end) if wrong else 0.0
        longest = max(longest, hop.end - begun if wrong else 0.0)
    return Loads(model, motion, seed, every_s, len(after), float(np.mean(right)), float(np.mean(bad)), longest)


def _record(it: Joint, motion: str, seed: int, every_s: float) -> Watched:
    rng, values = np.random.default_rng([seed, 13]), it.values(seed)
    loop, since = it.moving(motion, values, seed), BEFORE_S[motion]
    parts, begins, held = [stretch(loop, since, it.rate)], [0.0], [1.0]
    while loop.joint.time < since + WATCHED_S:
        begins.append(loop.joint.time)
        held.append(CARRIED if held[-1] == 1.0 else 1.0)
        loop.change(_with(it, values, held[-1]))
        parts.append(stretch(loop, every_s * rng.uniform(1.0 - JITTER, 1.0 + JITTER), it.rate))
    shown, true = (joined([part[k] for part in parts]) for k in (0, 1))
    time = np.arange(len(next(iter(shown.values())))) / it.rate

    def truth(t: float) -> Mapping[str, float]:
        return it.truth(_with(it, values, held[int(np.searchsorted(begins, t - 1e-9)) - 1]))

    return Watched(it.recording(time, shown), since, truth, moves(time, true))


def _with(it: Joint, values: Mapping[str, float], factor: float) -> dict[str, float]:
    return {**values, **{name: factor * values[name] for name in it.parts["load"]}}
