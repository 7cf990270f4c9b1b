"""What simple motions of a joint cannot show: one that is slow, and one that never reverses."""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.search import Search
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.sentences import listed, sentence
from joint_id_core.results.verdict import Verdict
from joint_id_core.simulation.minimum_jerk import minimum_jerk

SLOW = 0.05  # of the limit of velocity


def cannot_show(search: Search, home: float) -> tuple[str, ...]:
    """Say which parameters motions of the same time under the same limits cannot show, as sentences.

    Args:
        search: under these limits.
        home: in rad, from where the slow motion goes to the upper limit and back.
    """
    kinds = {
        f"a slow motion (there and back once, at most {SLOW:.0%} of the limit of velocity)": _slow(search, home),
        "a motion in one direction, without a reversal,": _one_way(search),
    }
    return tuple(
        sentence(f"{what} does not show {listed(unseen)}")
        for what, motion in kinds.items()
        if (unseen := _unseen(search, *motion))
    )


def _unseen(search: Search, position: Array, velocity: Array) -> list[str]:
    """Return the names of the parameters that a fit of a motion (T,) would not call estimated."""
    foresight = search.foresight
    try:
        covariance = foresight.see(search.joints[0], position, velocity).covariance
    except JointIdError:  # it moves too little for a fit
        return list(foresight.free)
    rows = foresight.verdicts(covariance, position, velocity)
    return [name for name in foresight.free if rows[name].verdict is not Verdict.ESTIMATED]


def _slow(search: Search, home: float) -> tuple[Array, Array]:
    """Return position and velocity of one period of a raised cosine."""
    turn, time = 2.0 * math.pi / search.duration, _time(search)
    room = float(search.limits.upper[0]) - home
    size = 0.5 * min(room, 2.0 * SLOW * float(search.limits.velocity[0]) / turn)
    return home + size * (1.0 - np.cos(turn * time)), size * turn * np.sin(turn * time)


def _one_way(search: Search) -> tuple[Array, Array]:
    """Return position and velocity of the smoothest way from one limit to the other."""
    low, high = float(search.limits.lower[0]), float(search.limits.upper[0])
    share, rate = minimum_jerk(_time(search) / search.duration)
    return low + (high - low) * share, (high - low) / search.duration * rate


def _time(search: Search) -> Array:
    """Return the instants of samples in s, (T,)."""
    rate = search.foresight.rate
    return np.arange(round(search.duration * rate) + 1) / rate
