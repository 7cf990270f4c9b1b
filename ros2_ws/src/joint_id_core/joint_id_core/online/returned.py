"""A load that was put down: the joint is as it was before an earlier change.

Then all is known of the other parameters that was known before that change, and the load needs no second stretch of
samples that confirms it. Only a load comes and goes. Friction that seems to is that of a current with an offset, which
looks like more friction in one direction and less in the other.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.learning import VAGUE, Explanation
from joint_id_core.online.memory import Change
from joint_id_core.online.piece import Piece
from joint_id_core.online.relearn import relearn
from joint_id_core.online.tracker import Tracker
from joint_id_core.results.estimate import SHOWN

LOAD = "load"  # group of parameters
CLEARLY = 6.0  # difference of minus twice the logarithm of the evidence from which the joint is as it was before


def returned(
    tracker: Tracker,
    stretches: Sequence[Piece],
    known: Change,
    newest: Change,
    recent: Collection[int],
    instead: Explanation,
    coordinates: Coordinates,
) -> Explanation | None:
    """Explain stretches of samples after a change by the joint as it was before an earlier one.

    Args:
        tracker, stretches, coordinates: as in `learning.learn`.
        known, newest: the earlier and the newest change; only what was known before them counts.
        recent: parameters that had just been learned anew at the newest one, as indices, so that little may have been
            known of them. If these are all, no part of what was known held: this is no joint whose load comes and goes.
        instead: explanation of these samples by new values.

    Returns:
        The explanation. The load is learned anew in it, as the next one may be a little heavier. None if the joint as
        it was is not clearly more likely than `instead`; so samples that hardly show the load tell of no return.
    """
    moved, vague = _moved(known, newest), _vague(newest, recent, coordinates)
    stretches = tracker.since_change(stretches)
    if not stretches or {coordinates.groups[j] for j in moved} != {LOAD} or len(recent) == len(newest.mean):
        return None
    other = tuple(sorted(moved | vague))
    spread, as_before = coordinates.spread, replace(known, names=(), likely=())
    learned = relearn(tracker, stretches, *as_before.still_known(spread), from_mean=True)
    if learned is None or not learned.explained:
        return None
    if Explanation(as_before, learned).unlikely(spread) > instead.unlikely(spread) - CLEARLY:
        return None
    may = replace(known, names=(), likely=other)
    learned = relearn(tracker, stretches, *may.still_known(spread), from_mean=True)
    return None if learned is None else Explanation(may, learned, replace(newest, names=other, likely=()))


def _moved(known: Change, newest: Change) -> set[int]:
    """Return the parameters that were other before the two changes, as indices."""
    sigma = np.sqrt(np.diag(known.covariance) + np.diag(newest.covariance))
    return set(np.flatnonzero(np.abs(known.mean - newest.mean) > SHOWN * sigma).tolist())


def _vague(newest: Change, recent: Collection[int], coordinates: Coordinates) -> set[int]:
    """Return the recent parameters of which little was known before the newest change."""
    sigma = np.sqrt(np.diag(newest.covariance))
    return {j for j in recent if sigma[j] > VAGUE * coordinates.unit[j]}
