"""What a stretch of samples says of the noise, and what noise does to what the stretch says of the parameters.

Each function passes the stretch through the filter again; the filter then goes on as if it had not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker

# How the parameters depend on noise takes a pass for each source of it: it is computed of the first stretches, and then
# of a part of them, which stand for the others.
OFTEN, RARELY = 4, 4
NUDGE = 0.1  # relative change of a noise variance for a derivative
# Part of the noise of the drive that is taken for that of its sensor. All of it moves the joint, or nothing: which of
# the two, only long records can tell.
OF_SENSOR = 0.5


def weight(seen: int) -> int:
    """Return how many stretches the next one stands for, 0 if others stand for it; `seen` came before it."""
    if seen < OFTEN:
        return 1
    return RARELY if seen % RARELY == 0 else 0


def noise_information(tracker: Tracker, piece: Piece) -> tuple[Array, Array] | None:
    """Return what a stretch says of the logarithms of the noise levels; None if the path diverges.

    These are the score (L,) and the information matrix (L, L).
    """
    levels, data = tracker.levels, tracker.data
    found = tracker.passed_again(piece, levels, stored=True)
    if not np.isfinite(found.cost):
        return None
    score, matrix = np.empty_like(levels), np.empty((len(levels), len(levels)))
    tracker.kernel.gains.noise_information(
        found.y, data.label_states, np.full(len(found.y), -1), found.errors, found.variances, found.gains,
        found.slopes, found.shown, score, matrix,
    )  # fmt: skip
    return score * levels, matrix * np.outer(levels, levels)


def cross_information(tracker: Tracker, piece: Piece) -> Array:
    """Return how the score of the parameters in a stretch depends on the noise levels, shape (k, L).

    It is the derivative by the logarithms of the levels, in estimation coordinates.
    """
    levels = tracker.levels
    scores = [tracker.passed_again(piece, by * levels).score for by in 1.0 + NUDGE * np.eye(len(levels))]
    change = np.array(scores).T - tracker.passed_again(piece, levels).score[:, None]
    cross = _free(tracker, piece, change) / np.log1p(NUDGE)
    return cross if np.isfinite(cross).all() else np.zeros_like(cross)


def attenuation(tracker: Tracker, piece: Piece, rng: np.random.Generator) -> Array:
    """Return the effect of the noise of the sensors of inputs on the score in a stretch, shape (k,).

    The noise is added with both signs and the results are averaged, so that only the second-order effect, the bias,
    remains. Zero if a pass with added noise diverges.
    """
    u, levels = piece.samples.u, tracker.levels
    more = np.zeros_like(u)
    for i, variance in _of_sensors(tracker).items():
        more[:, i] = np.sqrt(variance) * rng.standard_normal(len(u))
    noisier = [replace(piece, samples=replace(piece.samples, u=u + by * more)) for by in (1.0, -1.0)]
    plus, minus, here = (tracker.passed_again(p, levels).score for p in (*noisier, piece))
    change = _free(tracker, piece, (0.5 * (plus + minus) - here)[:, None])[:, 0]
    return change if np.isfinite(change).all() else np.zeros_like(change)


def _of_sensors(tracker: Tracker) -> dict[int, float]:
    """Return the noise variance of the sensor of each measured input, by index.

    That of a motion is what the signal shows. That of a drive is not more than the filter sees; a controller that
    follows noisy sensors makes a drive that is not smooth.
    """
    found, of_inputs = dict[int, float](), tracker.levels[len(tracker.data.labels) :]
    for i, variance in tracker.input_noise.items():
        motion = tracker.data.model.inputs[i].hold == "first"
        found[i] = variance if motion else OF_SENSOR * min(variance, float(of_inputs[i]))
    return found


def _free(tracker: Tracker, piece: Piece, score: Array) -> Array:
    """Return scores (parameters, n) as those of the coordinates of the free parameters, shape (k, n)."""
    return np.asarray(score[tracker.columns] * tracker.coordinates.slope(piece.z)[:, None])
