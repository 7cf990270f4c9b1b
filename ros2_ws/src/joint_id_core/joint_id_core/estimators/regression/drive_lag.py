"""Whether a drive is late or early, from a recording alone."""

from __future__ import annotations

import numpy as np

from joint_id_core.checking.signals import known
from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import across_gear
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.fit import regressed
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import build

MOTION = ("_position", "_velocity")
MOST_SAMPLES = 50_000  # of a longer recording the part of this length with most motion will do


def drive_lag(recording: Recording) -> str:
    """Return how late or early torque or current are against the motion of a rigid joint; empty if they are not."""
    measured = [n for n in recording.channels if recording.measured(n)]
    drive = next((n for n in ("torque", "current") if n in measured), None)
    sides = [side for side in ("link", "motor") if any(f"{side}{kind}" in measured for kind in MOTION)]
    if drive is None or not sides:
        return ""
    channels = {n: recording[n] for n in measured if n.startswith(sides[0]) or n == drive}
    channels |= {n: recording[n] for n in ("external_torque",) if n in recording}  # it may be computed
    if sides[0] == "motor":
        channels = {across_gear(n) or n: values for n, values in channels.items()}
    has_angle = sides[0] == "link" and "link_position" in channels
    model = build("rigid_joint", gravity=has_angle, actuation=drive)
    values = {"k_t": 1.0} if drive == "current" else {}
    try:
        part = _liveliest(Recording(recording.time, channels))
        fitted = regressed(model, part, ParameterSettings(values), Regression())
    except JointIdError:
        return ""
    return next((f.lag for f in fitted if f.lag), "")


def _liveliest(recording: Recording) -> Recording:
    """Return the part of at most `MOST_SAMPLES` in which the motion varies most."""
    moved = next(n for n in recording.channels if n.endswith(MOTION))
    parts = [recording.slice(k, k + MOST_SAMPLES) for k in range(0, len(recording), MOST_SAMPLES)]
    return max(parts, key=lambda part: float(np.ptp(known(part[moved]))) if part.measured(moved) else 0.0)
