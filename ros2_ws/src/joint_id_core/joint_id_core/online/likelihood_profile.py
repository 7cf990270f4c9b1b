"""What samples say along combinations of parameters that are hardly known: profiles of the likelihood.

A memory is linear. Along a combination that is known to a factor of two or ten, the likelihood is a long, bent valley
and no parabola: its bottom leads to other values of parameters that seem to be well known, and the lowest point may be
elsewhere. So the filter passes the blocks again at points along the valley, each the minimum over all other
combinations (profile likelihood, Venzon & Moolgavkar, Applied Statistics 37, 1988).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.search import APART, CLOSE
from joint_id_core.online.memory import Memory
from joint_id_core.online.piece import Piece
from joint_id_core.online.relearn import relearn
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
    variance: float
    excess: Array


@dataclass(frozen=True)
class Profiles:
    """Profiles of a memory: its lowest minimum, and the combinations that are hardly known there.

    Attributes:
        z: the minimum, shape (k,).
        lower: whether it is another one than that of the memory, with a lower cost.
        axes: the combinations.
        others: minima that are nearly as likely, and elsewhere.
    """

    z: Array
    lower: bool
    axes: tuple[Axis, ...]
    others: tuple[Array, ...]


@dataclass(frozen=True)
class _Point:
    """A minimum, shape (k,), what the blocks say there, and its cost."""

    z: Array
    pieces: list[Piece]
    cost: float


class _Valley:
    """Cost of the blocks of a memory, and its minima where a combination is held."""

    def __init__(self, tracker: Tracker, memory: Memory, memory_s: float) -> None:
        self._tracker, self._blocks = tracker, memory.blocks
        self._weights = memory.weights(memory_s)
        self._mean, self._precision = memory.before(memory_s)

    def minimum(self, z: Array) -> _Point | None:
        """Return the minimum that is found from z (k,); None if the path diverges."""
        return self._found(z, self._mean, self._precision)

    def held(self, z: Array, along: Array) -> _Point | None:
        """Return the same where the combination `along` (k,) keeps its value at z."""
        pin = HELD * np.outer(along, along)
        precision = self._precision + pin
        return self._found(z, solve(precision, self._precision @ self._mean + pin @ z), precision)

    def covariance(self, pieces: list[Piece]) -> Array:
        """Return the covariance of the parameters at a minimum, shape (k, k)."""
        return inverse_of(self._precision + np.tensordot(self._weights, [piece.matrix for piece in pieces], 1))

    def _found(self, z: Array, mean: Array, precision: Array) -> _Point | None:
        if self._tracker.again(self._blocks, z) is None:
            return None
        found = relearn(self._tracker, self._blocks, mean, precision, weights=self._weights)
        if found is None:
            return None
        of_samples = found.cost - (found.z - mean) @ precision @ (found.z - mean)
        away = found.z - self._mean
        return _Point(found.z, found.pieces, float(of_samples + away @ self._precision @ away))


def profiled(
    tracker: Tracker, memory: Memory, coordinates: Coordinates, memory_s: float, others: Sequence[Array] = ()
) -> Profiles | None:
    """Return the profiles of a memory; None if its blocks cannot be passed again.

    Args:
        tracker: which then stands somewhere else.
        memory: with the blocks since its begin.
        coordinates: of the parameters.
        memory_s: time constant of forgetting.
        others: parameters near which there may be minima, shapes (k,).
    """
    valley = _Valley(tracker, memory, memory_s)
    begun = valley.minimum(coordinates.clip(memory.mean))
    if begun is None:
        return None
    there = [valley.minimum(coordinates.clip(z)) for z in (memory.before(memory_s)[0], *others)]
    found = [begun, *(one for one in there if one is not None)]
    for _ in range(1 + ANEW):
        best = min(found, key=lambda one: one.cost)
        axes, lowest = _axes(valley, best, coordinates)
        if lowest.cost > best.cost - LOWER:
            break
        lower = valley.minimum(lowest.z)
        if lower is None or lower.cost > best.cost - LOWER:
            break
        found.append(lower)
    if best.cost > begun.cost - LOWER:
        best = begun
    covariance = valley.covariance(best.pieces)
    apart = [one.z for one in found if one.cost < best.cost + CLOSE and _distance(one.z - best.z, covariance) > APART]
    return Profiles(best.z, best is not begun, tuple(axes), tuple(apart))


def _axes(valley: _Valley, best: _Point, coordinates: Coordinates) -> tuple[list[Axis], _Point]:
    """Return the combinations that are hardly known at a minimum, and the lowest point of their profiles."""
    axes, lowest, unit = list[Axis](), best, coordinates.unit
    variances, directions = np.linalg.eigh(valley.covariance(best.pieces) / np.outer(unit, unit))
    for k in np.flatnonzero(variances > UNSURE**2).tolist():
        sigma, along, places = float(np.sqrt(variances[k])), directions[:, k], [(0.0, 0.0, best.z)]
        for side in (sigma, -sigma):
            for place, point in _walk(valley, best.z, coordinates, along, side):
                places.append((place / sigma, point.cost - best.cost, point.z))
                lowest = min(lowest, point, key=lambda one: one.cost)
                if point.cost > lowest.cost + RISEN:
                    break
        axes.append(Axis(along, float(variances[k]), _excess(places, unit * along * sigma)))
    return axes, lowest


def _distance(away: Array, covariance: Array) -> float:
    """Return a distance (k,) in standard deviations."""
    return float(np.sqrt(away @ solve(covariance, away)))


def _walk(
    valley: _Valley, z: Array, coordinates: Coordinates, along: Array, side: float
) -> Iterator[tuple[float, _Point]]:
    """Yield places along a combination, in its coordinate, with the minima over all others there.

    `side` is a standard deviation with the sign of the direction.
    """
    step, unit = float(np.clip(side, -STEP, STEP)), coordinates.unit
    begin, at = along @ (z / unit), z
    for _ in range(FARTHEST):
        ahead = coordinates.clip(at + step * unit * along)
        found = valley.held(ahead, along / unit)
        if found is None or not np.isfinite(found.cost):
            return
        at = found.z
        yield float(along @ (at / unit) - begin), found


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
