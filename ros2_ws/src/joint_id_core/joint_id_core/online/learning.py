"""Which parameters changed, and their new values, from the samples since the change.

The score test of the memory is linear. It finds a change, but where the change is large it may name nearly all
parameters. So the candidates are fitted: as few of them as explain the samples (forward selection). With a parameter
its whole group is fitted, because all friction warms together, even where these samples do not show all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from scipy.special import chdtri

from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.memory import ALIKE, Change
from joint_id_core.online.relearn import Learned, relearn
from joint_id_core.online.tracker import Piece, Tracker

UNNEEDED = 0.01  # probability from which a lower cost with more changed parameters counts as noise


@dataclass(frozen=True)
class Explanation:
    """The change with the parameters that are needed, and the fit of their new values."""

    change: Change
    learned: Learned


def learn(tracker: Tracker, stretches: Sequence[Piece], change: Change, coordinates: Coordinates) -> Explanation | None:
    """Fit the changed parameters to stretches of samples after the change; the others keep what was known.

    Args:
        tracker: it ends at the end of the stretches, at the new values.
        stretches: samples after the change.
        change: what the memory has found.
        coordinates: of the parameters.

    Returns:
        The explanation with the fewest changed parameters; None if none explains the samples.
    """
    best = _fitted(tracker, stretches, _grouped(change, coordinates), coordinates)
    for count in range(1, len(change.names)):
        fewer = _grouped(replace(change, names=change.names[:count], likely=()), coordinates)
        missing = len(coordinates.groups) - len(fewer.names) - len(fewer.likely)
        found = _fitted(tracker, stretches, fewer, coordinates)
        if found is None or (best is not None and _worse(found, best, missing)):
            continue
        best = _with_others(tracker, stretches, found, coordinates) if count == 1 else found
        break
    if best is not None and tracker.z is not best.learned.z:
        tracker.again(stretches, best.learned.z, changed=True)
    return best


def _grouped(change: Change, coordinates: Coordinates) -> Change:
    """Return the change with the groups of its parameters as likely ones."""
    groups = {coordinates.groups[j] for j in change.names} - {""}
    more = [j for j, group in enumerate(coordinates.groups) if group in groups]
    return replace(change, likely=tuple({*change.likely, *more} - {*change.names}))


def _worse(found: Explanation, most: Explanation, missing: int) -> bool:
    return found.learned.cost - most.learned.cost > float(chdtri(max(1, missing), UNNEEDED))


def _fitted(
    tracker: Tracker, stretches: Sequence[Piece], change: Change, coordinates: Coordinates
) -> Explanation | None:
    """Fit the parameters that a change names; None if this does not explain the samples."""
    learned = relearn(tracker, stretches, *change.still_known(coordinates.spread), changed=True)
    return Explanation(change, learned) if learned is not None and learned.explained else None


def _with_others(
    tracker: Tracker, stretches: Sequence[Piece], found: Explanation, coordinates: Coordinates
) -> Explanation:
    """Return the explanation with those parameters as likely ones whose change explains the samples nearly as well."""
    change = found.change
    others = list[int]()
    for j in range(len(coordinates.groups)):
        if j in (*change.names, *change.likely, *others):
            continue
        instead = _grouped(replace(change, names=(j,), likely=()), coordinates)
        other = _fitted(tracker, stretches, instead, coordinates)
        if other is not None and other.learned.cost < found.learned.cost + ALIKE:
            others += [*instead.names, *instead.likely]
    if not others:
        return found
    wider = replace(change, likely=tuple({*change.likely, *others} - {*change.names}))
    return _fitted(tracker, stretches, wider, coordinates) or found
