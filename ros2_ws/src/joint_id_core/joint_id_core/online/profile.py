"""What samples say along combinations of parameters that are hardly known: profiles of the likelihood.

A memory is linear. Along a combination that is known to a factor of two or ten, the likelihood is a long, bent valley
and no parabola: its bottom leads to other values of parameters that seem to be well known, and the lowest point may be
elsewhere. So the filter passes the blocks again at points along the valley, each the minimum over all other
combinations (profile likelihood, Venzon & Moolgavkar, Applied Statistics 37, 1988).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.online.memory import Memory
from joint_id_core.online.piece import Piece
from joint_id_core.online.relearn import Learned, relearn
from joint_id_core.online.symmetric import inverse_of, solve
from joint_id_core.online.tracker import Tracker

UNSURE = 0.02  # standard deviation of a combination of coordinates from which its profile is followed
STEP = 1.0  # longest step along a profile, in coordinates and in standard deviations
FARTHEST = 8  # steps to each side
RISEN = 9.0  # cost above the minimum at which a profile ends: three standard deviations
LOWER = 1.0  # cost below the minimum from which a point belongs to a lower one
ANEW = 3  # times that the search goes on from a lower minimum
HELD = 1e4  # precision with which the place along a profile is held


@dataclass(frozen=True)
class Axis:
    """A combination that is hardly known.

    Attributes:
        along: unit vector of the combination, in units of the coordinates, shape (k,).
        variance: of the combination.
        excess: what the covariance of the memory lacks, shape (k, k).
    """

    along: Array
    variance: Array
    excess: Array


@dataclass(frozen=True)
class Profiles:
    """Profiles of a memory: its lowest minimum, and the combinations that are hardly known there.

    Attributes:
        z: the minimum, shape (k,).
        lower: by how much its cost is lower than that of the estimate of the memory.
        axes: the combinations.
    """

    z: Array
    lower: float
    axes: tuple[Axis, ...]


class _Valley:
    """Cost of the blocks of a memory, and its minima where a combination is held."""

    def __init__(self, tracker: Tracker, memory: Memory, memory_s: float) -> None:
        self._tracker, self._blocks = tracker, memory.blocks
        self._weights = memory.weights(memory_s)
        self._mean, self._precision = memory.before()

    def minimum(self, z: Array) -> tuple[Learned, float] | None:
        """Return the minimum that is found from z (k,), and its cost; None if the path diverges."""
        return self._found(z, self._mean, self._precision)

    def held(self, z: Array, along: Array) -> tuple[Learned, float] | None:
        """Return the same where the combination `along` (k,) keeps its value at z."""
        pin = HELD * np.outer(along, along)
        precision = self._precision + pin
        return self._found(z, solve(precision, self._precision @ self._mean + pin @ z), precision)

    def covariance(self, pieces: list[Piece]) -> Array:
        """Return the covariance of the parameters at a minimum, shape (k, k)."""
        return inverse_of(self._precision + np.tensordot(self._weights, [piece.matrix for piece in pieces], 1))

    def _found(self, z: Array, mean: Array, precision: Array) -> tuple[Learned, float] | None:
        if self._tracker.again(self._blocks, z) is None:
            return None
        found = relearn(self._tracker, self._blocks, mean, precision, weights=self._weights)
        if found is None:
            return None
        of_samples = found.cost - (found.z - mean) @ precision @ (found.z - mean)
        away = found.z - self._mean
        return found, float(of_samples + away @ self._precision @ away)


def profiled(tracker: Tracker, memory: Memory, coordinates: Coordinates, memory_s: float) -> Profiles | None:
    """Return the profiles of a memory; None if its blocks cannot be passed again.

    Args:
        tracker: which then stands somewhere else.
        memory: with the blocks since its begin.
        coordinates: of the parameters.
        memory_s: time constant of forgetting.
    """
    valley = _Valley(tracker, memory, memory_s)
    found = valley.minimum(coordinates.clip(memory.mean))
    if found is None:
        return None
    first, axes = found[1], list[Axis]()
    other = valley.minimum(coordinates.clip(memory.before()[0]))
    if other is not None and other[1] < first - LOWER:
        found = other
    for _ in range(1 + ANEW):
        (best, cost), axes, lowest = found, [], None
        unit = coordinates.unit
        variances, directions = np.linalg.eigh(valley.covariance(best.pieces) / np.outer(unit, unit))
        for k in np.flatnonzero(variances > UNSURE**2).tolist():
            sigma, along, places = float(np.sqrt(variances[k])), directions[:, k], [(0.0, 0.0, best.z)]
            for side in (sigma, -sigma):
                for place, point, at in _walk(valley, best.z, coordinates, along, side):
                    places.append((place / sigma, at - cost, point.z))
                    if lowest is None or at < lowest[1]:
                        lowest = point, at
                    if at > min(cost, lowest[1]) + RISEN:
                        break
            axes.append(Axis(along, variances[k], _excess(places, unit * along * sigma)))
        if lowest is None or lowest[1] > cost - LOWER:
            break
        there = valley.minimum(lowest[0].z)
        if there is None or there[1] > cost - LOWER:
            break
        found = there
    return Profiles(found[0].z, first - found[1], tuple(axes))


def _walk(
    valley: _Valley, z: Array, coordinates: Coordinates, along: Array, side: float
) -> Iterator[tuple[float, Learned, float]]:
    """Yield places along a combination, in its coordinate, with the minima over all others there and their costs.

    `side` is a standard deviation with the sign of the direction.
    """
    step, unit = float(np.clip(side, -STEP, STEP)), coordinates.unit
    begin, at = along @ (z / unit), z
    for _ in range(FARTHEST):
        ahead = coordinates.clip(at + step * unit * along)
        found = valley.held(ahead, along / unit)
        if found is None or not np.isfinite(found[1]):
            return
        at = found[0].z
        yield float(along @ (at / unit) - begin), *found


def _excess(places: list[tuple[float, float, Array]], linear: Array) -> Array:
    """Return what the covariance lacks along a profile, shape (k, k).

    Args:
        places: along the profile in standard deviations, with the rise of the cost and the parameters there; the
            minimum comes first.
        linear: how the parameters move along the profile by the memory, by standard deviation, shape (k,).
    """
    place, rise = np.array([(p[0], p[1]) for p in places]).T
    bent = np.array([z - places[0][2] - p * linear for p, _, z in places])
    weights = np.exp(-0.5 * (rise - rise.min()))
    weights /= weights.sum()
    longer = max(0.0, float(weights @ place**2) - 1.0)
    return np.asarray((bent.T * weights) @ bent + longer * np.outer(linear, linear))
