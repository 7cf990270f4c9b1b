"""Noise of a recorded drive: does it move the joint, or is it of the sensor, and biases the estimates?

The part of the drive that its last samples do not foresee is tested as a torque that does not act, as it is and one
sample later. If all of the noise is of the sensor, the same noise once more changes the scores of these tests by as
much again (simulation extrapolation, as in `input_noise`); if all of it moves the joint, they are those of chance.
Between the two, the scores tell the fraction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.input_noise import effect_on_score, noisier, shown_noise, with_load
from joint_id_core.estimators.innovations.missing_torques import unforeseen
from joint_id_core.estimators.innovations.recursion import Pass, Recursion

FRACTIONS = 201  # that are compared
RANK = 1e-9  # of the information matrix of the two tests


@dataclass(frozen=True)
class DriveNoise:
    """What noise of a drive does to the coordinates as far as it is of the sensor.

    Attributes:
        fraction: mean of the fraction of its variance that is; any from 0 to 1 is as likely before the data.
        variance: of that fraction.
        of_all: bias of the coordinates if all of the noise is of the sensor, shape (k,).
    """

    fraction: float
    variance: float
    of_all: Array

    @property
    def excess(self) -> Array:
        """What adds to the covariance of the coordinates, shape (k, k).

        The values stay. With simulated sensors taking the bias off makes them right, but on a UR10e, whose currents
        have more than noise, it took 19 % off an inertia that was right.
        """
        return (self.variance + self.fraction**2) * np.outer(self.of_all, self.of_all)


def drive_noise(recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass) -> DriveNoise:
    """Return what noise of the drive does; `last` is the latest pass of the fit."""
    model, nothing = recursion.data.model, DriveNoise(0.0, 0.0, np.zeros_like(found.z))
    if model.torque_drive is None:
        return nothing
    channel = model.input_names.index(model.torque_drive)
    level = _level(recursion, found, channel)
    noisy = noisier(recursion, {channel: level}, last) if level > 0.0 else []
    if not noisy:
        return nothing
    bias = found.inverse @ effect_on_score(noisy, coordinates, last)
    bias = np.clip(bias, -coordinates.spread, coordinates.spread)
    scores, information = _test(recursion, coordinates, found, last, channel)
    added = np.mean([_test(one, coordinates, found, passed, channel)[0] for one, passed in noisy], axis=0) - scores
    weights = np.linalg.pinv(information, rcond=RANK, hermitian=True) @ added
    return DriveNoise(*mean_and_variance(float(weights @ scores), float(weights @ added)), bias)


def mean_and_variance(score: float, information: float) -> tuple[float, float]:
    """Return mean and variance of a fraction from 0 to 1 of which a score and its information are known."""
    if not (math.isfinite(score) and math.isfinite(information)):
        score, information = 0.0, 0.0
    fraction = np.linspace(0.0, 1.0, FRACTIONS)
    likely = fraction * score - 0.5 * fraction**2 * information
    weight = np.exp(likely - likely.max())
    mean = float(weight @ fraction / weight.sum())
    return mean, float(weight @ (fraction - mean) ** 2 / weight.sum())


def _level(recursion: Recursion, found: Minimum, channel: int) -> float:
    """Return the variance of the noise of an input: that of the filter, or of its third differences if this is less."""
    data = recursion.data
    levels = with_load(data.model, recursion.values(found.last.free), found.levels[len(data.labels) :])
    return min(float(levels[channel]), shown_noise(data).get(channel, 0.0))


def _test(
    recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass, channel: int
) -> tuple[Array, Array]:
    """Return scores (2,) and information (2, 2) of the unforeseen part of an input, beside the parameters."""
    now = unforeseen(recursion.data.u[:, channel])
    courses = np.column_stack([now, np.insert(now[:-1], 0, 0.0)])
    cross, total, scores = recursion.disturbances(last, np.array([channel, channel]), courses)
    slope = coordinates.slope_at(last.free)
    cross = slope[:, None] * cross
    by = cross.T @ found.inverse
    return scores - by @ (slope * last.gradient), total - by @ cross
