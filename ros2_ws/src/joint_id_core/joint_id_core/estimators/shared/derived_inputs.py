"""Inputs of a model that a recording lacks, derived from a position on the same side of the gear.

The filter of the derivative looks ahead: the motion after an instant enters the velocity at it. A joint that answers to
disturbances makes such an input tell about these, which no estimator expects. So the filter is as wide as noise allows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.velocity import CONTRADICTS, UNLIKE
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.shared.initial_state import rough_noise
from joint_id_core.estimators.shared.stillness import resolution
from joint_id_core.filtering.offline import HIGHEST, SIDES, FilterOptions, complete
from joint_id_core.models import Model

HIGH_HZ = 50.0  # below which a derivative has less noise than a velocity that is left out
NOISIER = 3e-3  # noise of such a velocity over its rms, at least
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


def without_bad_velocities(
    model: Model, recording: Recording, found: Sequence[Finding]
) -> tuple[Recording, tuple[Finding, ...]]:
    """Return a recording without measured velocities that are worse than the derivative of the position.

    Where a model takes both as inputs, it takes one for the derivative of the other. A velocity that is 10 % too large
    made a viscous friction 2.7 times as large, noise of 1 % a stiffness 17 % too small. The findings, returned as well,
    say so.
    """
    told, left = list(found), set[str]()
    for k, one in enumerate(told):
        if contradicts_inputs(one, model):
            velocity = next(name for name in one.channels if name.endswith("_velocity"))
            told[k] = replace(one, text=f"{one.text}; this fit derives {velocity} from the position")
            left.add(velocity)
    for position, velocity, _ in SIDES.values():
        if velocity in left or not {position, velocity} <= set(model.input_names):
            continue
        if recording.measured(position) and recording.measured(velocity):
            noise = _noise(recording[velocity])
            if noise > max(2.0 * math.pi * HIGH_HZ * _noise(recording[position]), NOISIER * _rms(recording[velocity])):
                text = f"the noise of {velocity} ({noise:.2g} rad/s) is more than that of the derivative of {position}"
                told.append(Finding(f"{text}: this fit derives {velocity} from the position", (position, velocity)))
                left.add(velocity)
    channels = {name: values for name, values in recording.channels.items() if name not in left}
    return (replace(recording, channels=channels) if left else recording), tuple(told)


def contradicts_inputs(found: Finding, model: Model) -> bool:
    """Return whether a finding says that a position contradicts a velocity, and a model takes both as inputs."""
    return found.about in (CONTRADICTS, UNLIKE) and set(found.channels) <= set(model.input_names)


def absent(model: Model, recording: Recording) -> list[str]:
    """Return the inputs of a model that a recording lacks, but for those that may be missing."""
    return [n for n in model.input_names if n not in recording and n not in model.optional_inputs]


def _widest(recording: Recording, position: str, velocity: Array, usual: FilterOptions) -> float:
    """Return the highest cutoff in Hz that keeps the noise of a velocity small, at least the usual one.

    White noise of variance s^2 at a rate f leaves (2 pi s)^2 2 c^3 / (3 f) below a cutoff c in its derivative.
    """
    rate, noise, speed = 1.0 / recording.period, _noise(recording[position]), _rms(velocity)
    most = (NOISY * speed / (2.0 * math.pi * noise)) ** 2 if noise > 0.0 else math.inf
    return max(usual.cutoff_hz, min(HIGHEST * rate, (1.5 * rate * most) ** (1.0 / 3.0)))


def _noise(row: Array) -> float:
    """Return the standard deviation of the noise of a signal, that of its rounding included."""
    row = row[np.isfinite(row)]
    return math.sqrt(rough_noise(row) + resolution(row) ** 2 / 12.0)


def _rms(row: Array) -> float:
    return math.sqrt(float(np.nanmean(row**2)))
