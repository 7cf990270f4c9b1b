"""The gear ratio that the motion of both sides shows, where that of the model is another one and the fit is bad."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

BAD = (Status.POOR_FIT, Status.MAX_ITERATIONS, Status.DIVERGED, Status.UNINFORMATIVE)
MOTOR, LINK = ("motor_position", "motor_velocity"), "link_position"
LEAST = 100  # samples
TOGETHER = 0.99  # squared correlation of both sides; what the gear twists is no ratio
SCALE = 0.05  # least relative error that is told: a gear that twists under gravity looks like less


def with_seen_ratio(estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings) -> Estimate:
    """Return a bad estimate with the gear ratio first that the signals show; others, or of the right one, as they are.

    It takes the motor's velocity where its position is not measured, as of a UR robot.
    """
    known = (*model.state_names, *model.input_names)
    side = next((n for n in MOTOR if n in known and recording.measured(n)), None)
    told = any("gear ratio N is" in note for note in estimate.notes)
    if estimate.status not in BAD or told or side is None or LINK not in known or not recording.measured(LINK):
        return estimate
    try:
        values = dict(zip(model.parameter_names, settings.applied_to(model)[0].tolist(), strict=True))
    except JointIdError:
        return estimate
    ratio, shown = model.gear_ratio(values), seen_ratio(recording, side)
    if shown is None or "N" not in values or "N" in estimate.free or abs(shown / ratio - 1.0) < SCALE:
        return estimate
    text = (
        f"{side} is about {shown:.3g} times that of the link, and the gear ratio N is {ratio:.4g}: correct N "
        f"(--set N={shown:.3g}), or the factor of the column (--map {side}={ratio / shown:.3g}*COLUMN)"
    )
    return estimate.noted((sentence(text), *estimate.notes), status=estimate.status)


def seen_ratio(recording: Recording, side: str) -> float | None:
    """Return how many times as far as the link the motor goes, by its position or velocity; None if that is not clear.

    Offsets and drifts do not matter.
    """
    motor, link = recording[side], recording[LINK]
    rows = np.isfinite(motor) & np.isfinite(link)
    if np.count_nonzero(rows) < LEAST:
        return None
    time, motor, link = recording.time[rows] - recording.time[0], motor[rows], link[rows]
    if side == "motor_velocity":
        motor = np.concatenate([[0.0], np.cumsum(0.5 * (motor[1:] + motor[:-1]) * np.diff(time))])
    line = np.column_stack([np.ones_like(time), time])
    motor, link = (y - line @ np.linalg.lstsq(line, y, rcond=None)[0] for y in (motor, link))
    both, of_motor, of_link = float(motor @ link), float(motor @ motor), float(link @ link)
    if not both**2 > TOGETHER * of_motor * of_link:
        return None
    return both / of_link
