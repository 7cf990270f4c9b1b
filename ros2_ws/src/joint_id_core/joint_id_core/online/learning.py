"""Which parameters changed, and their new values, from the samples since the change.

The score test of the memory is linear. It finds a change, but where the change is large it may name nearly all
parameters. So causes are fitted: a load that is picked up, friction that rises, a softer gear. Each is a group of
parameters. If one cause explains the samples, the other parameters keep what is known. If it takes more than one, any
parameter may have changed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.late_sensor import late_sensor
from joint_id_core.online.memory import Change, Memory
from joint_id_core.online.piece import Piece
from joint_id_core.online.relearn import Learned, relearn
from joint_id_core.online.score_test import ALIKE
from joint_id_core.online.symmetric import inverse_of, solve
from joint_id_core.online.tracker import Tracker

VAGUE = 0.5  # standard deviation of a coordinate, in its unit, from which little was known before
STAYED = 1e-5  # probability from which opened parameters may have stayed where they were
UNNEEDED = 0.001  # probability from which a lower cost with more changed parameters counts as noise


@dataclass(frozen=True)
class Explanation:
    """The change with the parameters that are opened, and the fit of their new values.

    `undoes` is set where the joint is again as it was before an earlier change: what was known of it just before.
    """

    change: Change
    learned: Learned
    undoes: Change | None = None

    @property
    def opened(self) -> tuple[int, ...]:
        """Parameters that were learned anew, as indices."""
        return *self.change.names, *self.change.likely

    @property
    def all_new(self) -> bool:
        """Whether nothing that was known before is kept."""
        return len(self.opened) == len(self.learned.z)

    def unlikely(self, spread: Array) -> float:
        """Return minus twice the logarithm of the evidence: see `Learned.occam`; `spread` as in `memory`."""
        return self.learned.cost + self.learned.occam(self.change.still_known(spread)[1])

    def memory(self, spread: Array, memory_s: float) -> Memory:
        """Return a memory of what is still known and of the samples since; `spread` (k,): prior standard deviations."""
        mean, precision = self.change.still_known(spread)
        memory = Memory(mean, np.asarray(np.linalg.inv(precision)), spread, changed=True)
        for piece in self.learned.pieces:
            memory.add(piece, memory_s)
        return memory


def learn(
    tracker: Tracker,
    stretches: Sequence[Piece],
    change: Change,
    coordinates: Coordinates,
    one_cause: bool,
) -> Explanation | None:
    """Fit changed parameters to stretches of samples after a change; the others keep what was known.

    Args:
        tracker: it ends at the end of the stretches, at the new values.
        stretches: samples after the change.
        change: what the memory has found.
        coordinates: of the parameters.
        one_cause: whether the joint may have changed once, by one cause; else any parameter may have changed.

    Returns:
        The explanation by one cause, with all causes opened that explain the samples nearly as well; else that by a
        change of all parameters; None if this does not explain the samples either, or a late sensor is more likely.
    """
    stretches = tracker.since_change(stretches)
    if not stretches:
        return None
    count = len(coordinates.groups)
    every = _fitted(tracker, stretches, change, range(count), coordinates)
    groups = causes(coordinates.groups) if one_cause else []
    single = [(group, _fitted(tracker, stretches, change, group, coordinates)) for group in groups]
    fits = [(group, found) for group, found in single if found is not None]
    least = min((found.learned.cost for _, found in fits), default=np.inf)
    best = every
    if every is None or least - every.learned.cost < float(chdtri(count - 1, UNNEEDED)):
        alike = [(group, found) for group, found in fits if found.learned.cost < least + ALIKE]
        if len(alike) == 1:
            best = alike[0][1]
        elif alike:
            opened = sorted(j for group, _ in alike for j in group)
            best = _fitted(tracker, stretches, change, opened, coordinates) or every
    explained = [found for found in (every, *(found for _, found in fits)) if found is not None]
    if best is not None and _late_instead(tracker, stretches, change, explained, coordinates):
        best = None
    if best is not None and tracker.z is not best.learned.z:
        tracker.again(stretches, best.learned.z)
    return best


def _late_instead(
    tracker: Tracker,
    stretches: Sequence[Piece],
    change: Change,
    explained: Sequence[Explanation],
    coordinates: Coordinates,
) -> bool:
    """Return whether a late sensor is clearly more likely than each change of the joint that explains the samples."""
    known, zs = inverse_of(change.covariance), [found.learned.z for found in explained]
    late = late_sensor(tracker, stretches, change.mean, known, zs)
    if late is None:
        return False
    least = np.inf
    for found, z, cost in zip(explained, zs, late.without, strict=True):
        mean, precision = found.change.still_known(coordinates.spread)
        least = min(least, cost + float((z - mean) @ precision @ (z - mean)) + found.learned.occam(precision))
    return late.learned.cost + late.learned.occam(known) + late.occam < least - ALIKE


def causes(groups: Sequence[str]) -> list[tuple[int, ...]]:
    """Return the parameters of each group, as indices; a parameter without a group is one by itself."""
    found: dict[str | int, list[int]] = {}
    for j, group in enumerate(groups):
        found.setdefault(group or j, []).append(j)
    return [tuple(members) for members in found.values()]


def _fitted(
    tracker: Tracker,
    stretches: Sequence[Piece],
    change: Change,
    opened: Collection[int],
    coordinates: Coordinates,
) -> Explanation | None:
    """Fit the opened parameters; None if this does not explain the samples.

    The one that moved most, in standard deviations, is the one that changed; the others may have. One of which little
    was known may explain anything: if all that is opened may have stayed where it was, this is no explanation.
    """
    may = replace(change, names=(), likely=tuple(opened))
    mean, precision = may.still_known(coordinates.spread)
    learned = relearn(tracker, stretches, mean, precision, from_mean=True)
    if learned is None or not learned.explained:
        return None
    information = np.sum([piece.matrix for piece in learned.pieces], axis=0)
    moved, covariance = learned.z - change.mean, np.linalg.inv(precision + information) + change.covariance
    sigma = np.sqrt(np.diag(covariance))
    first, own = max(opened, key=lambda j: abs(moved[j]) / sigma[j]), list(opened)
    vague = np.sqrt(change.covariance[first, first]) > VAGUE * coordinates.unit[first]
    if vague and moved[own] @ solve(covariance[np.ix_(own, own)], moved[own]) < float(chdtri(len(own), STAYED)):
        return None
    likely = tuple(j for j in opened if j != first)
    return Explanation(replace(change, names=(first,), likely=likely), learned)
