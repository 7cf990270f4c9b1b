"""New values of changed parameters, from the samples since the change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.verdicts import COLOURED, MOST_CHI2
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker

ITERATIONS = 20
SETTLED = 0.5  # squared length of the last step in standard deviations
RISE = 1.0  # of the cost in that step: its gradient lacks the slope of the variances of the innovations
LONGEST = 1.0  # longest step of a coordinate: a factor e in a positive parameter


@dataclass(frozen=True)
class Learned:
    """Values of the parameters, shape (k,), what the stretches say at these values, and the cost there."""

    z: Array
    pieces: list[Piece]
    cost: float

    @property
    def explained(self) -> bool:
        """Whether the innovations look like noise: mean square and lag-one autocorrelation."""
        return _explained(np.concatenate([piece.white for piece in self.pieces]))

    def occam(self, precision: Array) -> float:
        """Return what is to be added to the cost for a comparison with another fit that knew more or less before.

        With it, the cost is minus twice the logarithm of the evidence, by Laplace's method (MacKay, Neural Computation
        4, 1992): parameters that were hardly known may take any value, which makes each of them less likely.
        `precision` (k, k) is what was known.
        """
        information = np.sum([piece.matrix for piece in self.pieces], axis=0)
        return float(np.linalg.slogdet(precision + information)[1] - np.linalg.slogdet(precision)[1])


def relearn(
    tracker: Tracker,
    stretches: Sequence[Piece],
    mean: Array,
    precision: Array,
    weights: Sequence[float] | None = None,
    from_mean: bool = False,
    near: float = 0.0,
) -> Learned | None:
    """Fit the parameters to stretches of samples, with the noise levels of the tracker.

    Gauss-Newton iterations with Levenberg damping.

    Args:
        tracker: it ends at the end of the stretches, at the new values.
        stretches: the samples.
        mean, precision: what is known of the parameters without them, shapes (k,) and (k, k), in estimation
            coordinates.
        weights: of the stretches; 1 if not given.
        from_mean: whether the iteration starts at the mean, not at the values of the tracker.
        near: squared length in standard deviations of a step that is not made: what the stretches say is as good there.

    Returns:
        The minimum; None if the path diverges at the start.
    """
    coordinates = tracker.coordinates
    z, damping = coordinates.clip(mean if from_mean else tracker.z), 1e-3
    here = tracker.again(stretches, z)
    if here is None:
        return None
    share = np.ones(len(stretches)) if weights is None else np.array(weights)
    cost, pieces = float(here[0] @ share + (z - mean) @ precision @ (z - mean)), here[1]
    for _ in range(ITERATIONS):
        information = np.tensordot(share, [piece.matrix for piece in pieces], 1)
        matrix = precision + information
        gradient = share @ np.array([piece.vector for piece in pieces]) - information @ z - precision @ (z - mean)
        step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient)
        if damping < 1.0 and step @ matrix @ step < near:
            break
        longest = float(np.max(np.abs(step) / coordinates.unit))
        if longest > LONGEST:
            step *= LONGEST / longest
        moved = coordinates.clip(z + step)
        there = tracker.again(stretches, moved)
        worth = np.inf if there is None else float(there[0] @ share + (moved - mean) @ precision @ (moved - mean))
        last = step @ matrix @ step < SETTLED and worth < cost + RISE
        if last or worth < cost:
            assert there is not None
            z, cost, pieces, damping = moved, worth, there[1], max(0.1 * damping, 1e-9)
            if last:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    if tracker.z is not z:
        tracker.again(stretches, z)
    return Learned(z, pieces, cost)


def _explained(white: Array) -> bool:
    """Return whether innovations look like noise: mean square and lag-one autocorrelation."""
    for row in white.T:
        known = row[np.isfinite(row)]
        if len(known) < 20:
            continue
        energy = float(known @ known)
        slack = 4.0 / np.sqrt(len(known))
        if energy / len(known) > MOST_CHI2 + slack or abs(float(known[1:] @ known[:-1])) > (COLOURED + slack) * energy:
            return False
    return True
