"""Whether a drive is late or early, from a recording alone."""

from __future__ import annotations

import numpy as np

from joint_id_core.checking.sides import MOTION
from joint_id_core.checking.signals import known
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.as_rigid import regressed_as_rigid

MOST_SAMPLES = 50_000  # of a longer recording the part of this length with most motion will do


def drive_lag(recording: Recording) -> str:
    """Return how late or early torque or current are against the motion of a rigid joint; empty if they are not."""
    try:
        rigid = regressed_as_rigid(_liveliest(recording))
    except JointIdError:
        return ""
    return next((f.lag for f in rigid.fitted if f.lag), "") if rigid is not None else ""


def _liveliest(recording: Recording) -> Recording:
    """Return the part of at most `MOST_SAMPLES` in which the motion varies most."""
    moved = next((n for n in MOTION if recording.measured(n)), None)
    if moved is None:
        return recording
    parts = [recording.slice(k, k + MOST_SAMPLES) for k in range(0, len(recording), MOST_SAMPLES)]
    return max(parts, key=lambda part: float(np.ptp(known(part[moved]))) if part.measured(moved) else 0.0)
