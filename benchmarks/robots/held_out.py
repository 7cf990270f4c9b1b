"""How well parameters predict the drive of a recording that was not fitted, while the joint moves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.filtering.offline import FilterOptions, complete
from joint_id_core.models import Model
from joint_id_core.validation.inverse_dynamics import DRIVE_BAND_HZ, drive, drive_errors

NOTHING = 1e-9
MOVES = 0.02  # rad/s or m/s: below, a sticking joint may bear any torque


def r_squared_in_motion(model: Model, values: Mapping[str, float], recording: Recording) -> float:
    """R2 of the drive below 10 Hz, of samples in motion only; NaN where the drive is not known."""
    # Inverse dynamics divide by an inertia; a regression may find that there is none.
    values = {n: v or NOTHING if model.parameter(n).positive else v for n, v in values.items()}
    predicted, name = drive(model, values, recording), model.torque_drive
    if predicted is None or name is None:
        return float("nan")
    measured, nothing = recording[name], np.where(np.isfinite(predicted), 0.0, np.nan)
    errors = drive_errors(recording.time, measured, predicted)
    alone = drive_errors(recording.time, measured, nothing)  # over the same deviation: minus the drive itself
    smooth = complete(recording, FilterOptions(cutoff_hz=DRIVE_BAND_HZ))
    moves = np.abs(smooth["link_velocity"]) > MOVES
    moves &= np.isfinite(errors)
    return 1.0 - float(np.mean(errors[moves] ** 2)) / float(np.var(alone[moves]))
