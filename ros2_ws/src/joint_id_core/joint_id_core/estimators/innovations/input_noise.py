"""Bias from noise of a sensor whose signal is an input of the model (errors in variables).

The filter takes noise of an input for something that moves the joint and is independent of what is recorded. Noise of a
sensor is the opposite: it is in the record and moves nothing. It biases the estimates. Method: simulation extrapolation
(Cook & Stefanski, J. Am. Stat. Assoc. 89, 1994): the same amount of noise is added once more, and the change of the
score is measured.
"""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.initial_state import rough_noise

LEFT = 0.5  # of the bias that counts as uncertain after its correction; on simulated robots a third is left


def attenuation(
    recursion: Recursion, coordinates: Coordinates, found: Minimum, channel: int, variance: float, last: Pass
) -> Array:
    """Return the effect of noise of an input's sensor on the score of the coordinates, shape (k,).

    The noise is added with both signs and the results are averaged, so that only the second-order effect, the bias,
    remains. Zero if a pass with added noise diverges.
    """
    noise = np.sqrt(variance) * np.random.default_rng(0).standard_normal(len(recursion.data.time))
    scores = []
    for more in (noise, -noise):
        u = recursion.data.u.copy()
        u[:, channel] += more
        noisier = recursion.with_inputs(u).run(last.free, last.levels, last.steps)
        if not np.isfinite(noisier.cost):
            return np.zeros_like(found.z)
        scores.append(noisier.gradient)
    return np.asarray((0.5 * (scores[0] + scores[1]) - last.gradient) * coordinates.slope(found.z))


def motion_bias(recursion: Recursion, coordinates: Coordinates, found: Minimum, last: Pass) -> Array:
    """Return the bias of the coordinates from the noise of measured motions that are inputs, shape (k,).

    The level of the noise is what the signal itself shows. A velocity that was computed from a position passed a filter
    that leaves little noise. A bias beyond the spread of the prior is none: there the model does not describe the data.
    """
    data, score = recursion.data, np.zeros_like(found.z)
    for channel, signal in enumerate(data.model.inputs):
        if signal.hold == "first" and data.recording.measured(signal.name):
            variance = rough_noise(np.ascontiguousarray(data.u[:, channel]))
            score += attenuation(recursion, coordinates, found, channel, variance, last)
    return np.clip(found.inverse @ score, -coordinates.spread, coordinates.spread)
