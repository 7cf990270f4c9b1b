"""Bias from noise of a sensor whose signal is an input of the model (errors in variables).

The filter takes noise of an input for something that moves the joint and is independent of what is recorded. Noise of a
sensor is the opposite: it is in the record and moves nothing. It biases the estimates. Method: simulation extrapolation
(Cook & Stefanski, J. Am. Stat. Assoc. 89, 1994): the same amount of noise is added once more, and the change of the
score is measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.recursion import Pass, Recursion
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.initial_state import rough_noise
from joint_id_core.estimators.shared.stillness import resolution
from joint_id_core.models import Model
from joint_id_core.models.curved_inputs import last_rates

# Part of the noise of the drive that is taken for that of its sensor. All of it moves the joint, or nothing: which of
# the two, only long records can tell.
OF_SENSOR = 0.5


def shown_noise(data: FitData) -> dict[int, float]:
    """Return the noise variance that each measured input itself shows, by index; of a motion at least that of rounding.

    A velocity that was computed from a position passed a filter that leaves little noise.
    """
    found, mixed = {}, last_rates(data.model)  # of three samples each in `u`
    for i, signal in enumerate(data.model.inputs):
        if data.recording.measured(signal.name):
            row = data.recording[signal.name] if i in mixed else data.u[:, i]
            row = np.ascontiguousarray(row[np.isfinite(row)])
            rounding = resolution(row) ** 2 / 12.0 if signal.hold == "first" else 0.0
            found[i] = max(rough_noise(row), rounding)
    return found


def sensor_noise(model: Model, shown: Mapping[int, float], of_inputs: Array) -> dict[int, float]:
    """Return the noise variance of the sensor of each input, by index.

    That of a motion is what the signal shows. That of a drive is not more than the filter sees; a controller that
    follows noisy sensors makes a drive that is not smooth.

    Args:
        model: with these inputs.
        shown: see `shown_noise`.
        of_inputs: noise variances of the inputs in the filter, shape (inputs,).
    """
    return {
        i: variance if model.inputs[i].hold == "first" else OF_SENSOR * min(variance, float(of_inputs[i]))
        for i, variance in shown.items()
    }


def with_load(model: Model, values: Array, of_inputs: Array) -> Array:
    """Return noise variances of the inputs (inputs,), that of the drive with that of the load.

    Without a spring between them the filter cannot tell one from the other. `values` are those of all parameters (P,).
    """
    if model.torque_drive is None or model.stiffness is not None or model.load is None:
        return of_inputs
    named = dict(zip(model.parameter_names, values.tolist(), strict=True))
    at_link, together = model.gear_ratio(named) * model.torque_constant(named), of_inputs.copy()
    drive, load = (model.input_names.index(name) for name in (model.torque_drive, model.load))
    together[drive] += of_inputs[load] / at_link**2
    return together


def noisier(recursion: Recursion, variances: Mapping[int, float], last: Pass) -> list[tuple[Recursion, Pass]]:
    """Return passes over a record with added noise of these variances, by index of the input, and with its negative.

    The mean of what they show holds the second-order effect of the noise only, which is the bias. Empty if one of them
    diverges.
    """
    data, rng = recursion.data, np.random.default_rng(0)
    noise = np.zeros_like(data.u)
    for channel, variance in variances.items():
        noise[:, channel] = np.sqrt(variance) * rng.standard_normal(len(data.time))
    both = [recursion.with_inputs(data.u + by * noise) for by in (1.0, -1.0)]
    passes = [(one, one.run(last.free, last.levels, last.steps)) for one in both]
    return passes if all(np.isfinite(found.cost) for _, found in passes) else []


def effect_on_score(noisy: Sequence[tuple[Recursion, Pass]], coordinates: Coordinates, last: Pass) -> Array:
    """Return the effect of noise on the score of the coordinates, shape (k,), from the passes of `noisier`."""
    if not noisy:
        return np.zeros_like(last.gradient)
    mean = np.mean([found.gradient for _, found in noisy], axis=0)
    return np.asarray((mean - last.gradient) * coordinates.slope_at(last.free))


def with_motion_noise(recursion: Recursion, found: Minimum, last: Pass) -> list[tuple[Recursion, Pass]]:
    """Return the passes of `noisier` with the noise of the sensors of all measured inputs.

    Empty without a measured motion among the inputs: noise of the sensor of a drive alone is tested (`drive_noise`).
    """
    data = recursion.data
    shown = shown_noise(data)
    if not any(data.model.inputs[i].hold == "first" for i in shown):
        return []
    return noisier(recursion, sensor_noise(data.model, shown, found.levels[len(data.labels) :]), last)


def sensor_bias(
    noisy: Sequence[tuple[Recursion, Pass]], coordinates: Coordinates, found: Minimum, last: Pass
) -> Array:  # fmt: skip
    """Return the bias of the coordinates from the noise of measured inputs, shape (k,), with `with_motion_noise`.

    It counts as uncertain. Of the bias from noise of a motion a third is left on simulated robots; another one comes on
    top that is not known, as the link also answers to what disturbs the motor; and noise of a drive may be that of its
    sensor or move the joint. A bias beyond the spread of the prior is none: there the model does not describe the data.
    """
    score = effect_on_score(noisy, coordinates, last)
    return np.clip(found.inverse @ score, -coordinates.spread, coordinates.spread)
