"""What a stretch of samples says of the noise, and what noise and friction do to what it says of the parameters.

The functions pass a stretch through the filter again; the filter then goes on as if it had not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.input_noise import sensor_noise, with_load
from joint_id_core.estimators.innovations.recursion import NoiseInformation
from joint_id_core.online.piece import Piece
from joint_id_core.online.tracker import Tracker

# What noise of the inputs does to the parameters takes three passes: it is computed of the first stretches, and then of
# a part of them, which stand for the others.
OFTEN, RARELY = 4, 4


def weight(seen: int) -> int:
    """Return how many stretches the next one stands for, 0 if others stand for it; `seen` came before it."""
    if seen < OFTEN:
        return 1
    return RARELY if seen % RARELY == 0 else 0


def noise_information(tracker: Tracker, piece: Piece) -> NoiseInformation | None:
    """Return what a stretch says of the logarithms of the noise levels; None if the path or its derivatives diverge.

    The parameters are those of the estimation coordinates. Of a stretch that was not passed just now, the filter passes
    it again.
    """
    levels, data = tracker.levels, tracker.data
    found = piece.passed or tracker.passed_again(piece, levels, stored=True)
    if not np.isfinite(found.cost):
        return None
    score, matrix = np.empty_like(levels), np.empty((len(levels), len(levels)))
    cross, rows = np.empty((found.sensitivities.shape[2], len(levels))), slice(0, 1 + found.count)
    tracker.kernel.gains.noise_information(
        found.y[rows], data.label_states, np.full(1 + found.count, -1), found.errors[rows], found.variances[rows],
        found.gains[rows], found.slopes[rows], found.shown[rows], found.sensitivities[rows], score, matrix, cross,
    )  # fmt: skip
    cross = _free(tracker, piece, cross)
    if not all(np.isfinite(a).all() for a in (score, matrix, cross)):
        return None
    return NoiseInformation(score * levels, matrix * np.outer(levels, levels), cross * levels)


def attenuation(tracker: Tracker, piece: Piece, rng: np.random.Generator) -> Array:
    """Return the effect of the noise of the sensors of inputs on the score in a stretch, shape (k,).

    The noise is added with both signs and the results are averaged, so that only the second-order effect, the bias,
    remains. Zero if a pass with added noise diverges.
    """
    u, levels = piece.samples.u, tracker.levels
    more = np.zeros_like(u)
    model = tracker.data.model
    of_inputs = with_load(model, tracker.data.p, levels[len(tracker.data.labels) :])
    for i, variance in sensor_noise(model, tracker.shown_noise, of_inputs).items():
        more[:, i] = np.sqrt(variance) * rng.standard_normal(len(u))
    noisier = [replace(piece, samples=replace(piece.samples, u=u + by * more)) for by in (1.0, -1.0)]
    plus, minus, here = (tracker.passed_again(p, levels).score for p in (*noisier, piece))
    change = _free(tracker, piece, (0.5 * (plus + minus) - here)[:, None])[:, 0]
    return change if np.isfinite(change).all() else np.zeros_like(change)


def sharper(tracker: Tracker, piece: Piece, factor: float) -> Array:
    """Return the effect on the score (k,) of a stretch of friction whose smoothing velocities are smaller by a factor.

    Zero if a pass with it diverges.
    """
    # `piece.passed` has the score of its last samples only
    here, there = tracker.passed_again(piece, tracker.levels), tracker.passed_sharper(piece, factor)
    change = _free(tracker, piece, (there.score - here.score)[:, None])[:, 0]
    return change if np.isfinite(change).all() else np.zeros_like(change)


def _free(tracker: Tracker, piece: Piece, score: Array) -> Array:
    """Return scores (parameters, n) as those of the coordinates of the free parameters, shape (k, n)."""
    return np.asarray(score[tracker.columns] * tracker.coordinates.slope(piece.z)[:, None])
