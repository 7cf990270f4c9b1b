"""Inputs of a model that a recording lacks, derived from a position on the same side of the gear.

The filter of the derivative looks ahead: the motion after an instant enters the velocity at it. A joint that answers to
disturbances makes such an input tell about these, which no estimator expects. So the filter is as wide as noise allows.
"""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.shared.initial_state import rough_noise
from joint_id_core.estimators.shared.stillness import resolution
from joint_id_core.filtering.offline import HIGHEST, SIDES, FilterOptions, complete
from joint_id_core.models import Model

NOISY = 1e-3  # noise of a derived velocity over its rms that the widest filter leaves


def with_inputs(model: Model, recording: Recording) -> Recording:
    """Return a recording with derived velocities and accelerations, if the model has an input that it lacks."""
    missing = absent(model, recording)
    if not missing or len(recording) < 2:
        return recording
    usual = FilterOptions().fitting(recording.period)
    found = complete(recording, usual)
    cutoffs = [
        _widest(recording, position, found.channels[velocity], usual)
        for position, velocity, _ in SIDES.values()
        if velocity in missing and recording.measured(position)
    ]
    cutoff_hz = min(cutoffs, default=usual.cutoff_hz)
    return found if cutoff_hz <= usual.cutoff_hz else complete(recording, FilterOptions(cutoff_hz=cutoff_hz))


def absent(model: Model, recording: Recording) -> list[str]:
    """Return the inputs of a model that a recording lacks, but for those that may be missing."""
    return [n for n in model.input_names if n not in recording and n not in model.optional_inputs]


def _widest(recording: Recording, position: str, velocity: Array, usual: FilterOptions) -> float:
    """Return the highest cutoff in Hz that keeps the noise of a velocity small, at least the usual one.

    White noise of variance s^2 at a rate f leaves (2 pi s)^2 2 c^3 / (3 f) below a cutoff c in its derivative.
    """
    rate, row = 1.0 / recording.period, recording[position]
    row = row[np.isfinite(row)]
    noise = math.sqrt(rough_noise(row) + resolution(row) ** 2 / 12.0)
    speed = math.sqrt(float(np.nanmean(velocity**2)))
    most = (NOISY * speed / (2.0 * math.pi * noise)) ** 2 if noise > 0.0 else math.inf
    return max(usual.cutoff_hz, min(HIGHEST * rate, (1.5 * rate * most) ** (1.0 / 3.0)))
