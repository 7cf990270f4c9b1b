"""Noise of a recorded drive: does it move the joint, or is it of the sensor, and biases the estimates?

The part of the drive that its last samples do not foresee is tested as a torque that does not act. If all of the noise
is of the sensor, the same noise once more changes the score of that test by as much again (simulation extrapolation,
as in `input_noise`); if it moves the joint, the score is that of chance. Where the labels are too coarse to tell,
either is as likely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.input_noise import effect_on_score, noisier, shown_noise
from joint_id_core.estimators.innovations.missing_torques import unforeseen
from joint_id_core.estimators.innovations.recursion import Pass, Recursion


@dataclass(frozen=True)
class DriveNoise:
    """What noise of a drive does if it is of the sensor.

    Attributes:
        probability: that it is, from 0 to 1; without data a half.
        bias: of the coordinates, if it is, shape (k,).
    """

    probability: float
    bias: Array


def drive_noise(
    recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass, channel: int
) -> DriveNoise:  # fmt: skip
    """Return what noise of the input with index `channel` does; `last` is the latest pass of the fit.

    Its level is that of the filter, or that of the signal's third differences if this is smaller.
    """
    data = recursion.data
    level = min(float(found.levels[len(data.labels) + channel]), shown_noise(data).get(channel, 0.0))
    noisy = noisier(recursion, {channel: level}, last) if level > 0.0 else []
    if not noisy:
        return DriveNoise(0.0, np.zeros_like(found.z))
    bias = found.inverse @ effect_on_score(noisy, coordinates, last)
    bias = np.clip(bias, -coordinates.spread, coordinates.spread)
    score, information = _test(recursion, coordinates, found, last, channel)
    added = math.fsum(_test(one, coordinates, found, noisier_pass, channel)[0] for one, noisier_pass in noisy) / 2
    if not information > 0.0 or not math.isfinite(added):
        return DriveNoise(0.5, bias)
    expected = added - score
    return DriveNoise(float(expit((score - 0.5 * expected) * expected / information)), bias)


def _test(
    recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass, channel: int
) -> tuple[float, float]:
    """Return score and information of the unforeseen part of an input, beside the parameters."""
    course = unforeseen(recursion.data.u[:, channel])
    cross, total, score = recursion.disturbances(last, np.array([channel]), course[:, None])
    slope = coordinates.slope_at(last.free)
    by = found.inverse @ (slope * cross[:, 0])
    return float(score[0] - by @ (slope * last.gradient)), float(total[0, 0] - by @ (slope * cross[:, 0]))
