"""New values of changed parameters, from the samples since the change."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.verdicts import COLOURED, MOST_CHI2
from joint_id_core.online.tracker import Piece, Tracker

ITERATIONS = 20
SETTLED = 0.01  # squared length of the last step in standard deviations
LONGEST = 1.0  # longest step of a coordinate: a factor e in a positive parameter


def relearn(tracker: Tracker, stretch: Piece, mean: Array, precision: Array) -> tuple[Array, Array] | None:
    """Fit the parameters to a stretch that begins where they changed.

    Gauss-Newton iterations with Levenberg damping, with the noise levels of the tracker. The state at the begin of the
    stretch is that of the filter, which does not depend on the new values.

    Args:
        tracker: it ends at the end of the stretch, at the new values.
        stretch: samples since the change.
        mean, precision: what is still known of the parameters, shapes (k,) and (k, k), in estimation coordinates.

    Returns:
        The new estimate (k,) and its covariance (k, k); None if no values explain the stretch.
    """
    coordinates = tracker.coordinates
    z, damping = coordinates.clip(mean), 1e-3
    here = tracker.again(stretch, z)
    if here is None:
        return None
    cost, piece = here
    cost += (z - mean) @ precision @ (z - mean)
    for _ in range(ITERATIONS):
        matrix = precision + piece.matrix
        gradient = piece.vector - piece.matrix @ z - precision @ (z - mean)
        damped = matrix + damping * np.diag(np.diag(matrix))
        step = np.linalg.solve(damped, gradient)
        longest = float(np.max(np.abs(step) / coordinates.unit))
        if longest > LONGEST:
            step *= LONGEST / longest
        there = tracker.again(stretch, coordinates.clip(z + step))
        moved = coordinates.clip(z + step)
        worth = np.inf if there is None else there[0] + (moved - mean) @ precision @ (moved - mean)
        small = step @ matrix @ step
        if worth < cost or (small < SETTLED and worth < cost + 1.0):
            assert there is not None
            z, cost, piece, damping = moved, worth, there[1], max(0.1 * damping, 1e-9)
            if small < SETTLED:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    tracker.again(stretch, z)
    if not _explained(piece.white):
        return None
    return z, np.asarray(np.linalg.inv(precision + piece.matrix))


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
