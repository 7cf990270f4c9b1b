"""The gear ratio that the motion of both sides shows, where that of the model is another one.

A fit with a ratio that is off takes long, a hundred times as long as a good one, and tells nothing: it is not made.
With 100 in place of 101, which is soon mistaken of a strain wave gear, it told play and hysteresis of the gear. Where a
short recording does not tell the ratio exactly, one that is less than a factor of two off is made, since a link that is
excited near its resonance moves further than its motor.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from joint_id_core.checking.finding import Finding
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.exact_ratio import LINK, MOTOR, exact_ratio
from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

BAD = (Status.POOR_FIT, Status.MAX_ITERATIONS, Status.DIVERGED, Status.UNINFORMATIVE)
LEAST = 100  # samples
TOGETHER = 0.99  # squared correlation of both sides; what the gear twists is no ratio
SCALE = 0.05  # least relative error that is told: a gear that twists under gravity looks like less
FAR = 2.0  # factor from which no fit is made
MOST_NM = 1500.0  # torque at the link that no joint of a cobot has: twice those of the largest
OFF, SURE = 0.004, 10.0  # the same by `exact_ratio`: relative error, and that in standard deviations


def with_seen_ratio(estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings) -> Estimate:
    """Return a bad estimate with the gear ratio first that the signals show; others, or of the right one, as they are.

    It takes the motor's velocity where its position is not measured, as of a UR robot.
    """
    if estimate.status not in BAD or any("gear ratio N is" in note for note in estimate.notes):
        return estimate
    found = _other_ratio(model, recording, settings)
    if found is None:
        return estimate
    return estimate.noted((sentence(found.text), *estimate.notes), status=estimate.status)


def wrong_ratio(
    model: Model, estimator: str, recording: Recording, settings: ParameterSettings | None
) -> Estimate | None:
    """Return the estimate where the gear ratio is so far off that a fit would tell nothing; None if it is not."""
    found = _other_ratio(model, recording, settings or ParameterSettings())
    if found is None or not (found.exact or found.far):
        return None
    error = UnusableError(Status.BAD_DATA, f"{recording.source}: {found.text}")
    return unusable(model, estimator, error, recording, settings)


def torque_of_motor(model: Model, recording: Recording, settings: ParameterSettings | None) -> Iterator[Finding]:
    """Find that a motor turns more often than the link, where the model takes the torque as that of the link.

    Nothing in the motion tells on which side a torque was measured.
    """
    known = (*model.state_names, *model.input_names)
    at_link = "N" in model.parameter_names and not any(n in known for n in MOTOR) and LINK in known
    given = settings is not None and "N" in settings.values
    if given or not at_link or not recording.measured(LINK) or model.torque_drive is None:
        return
    for side in filter(recording.measured, MOTOR):  # a position that wraps, or is divided already, shows none
        shown = seen_ratio(recording, side)
        if shown is not None and abs(abs(shown) - model.gear_ratio(model.values())) > SCALE:
            size, drive = f"{abs(shown):.3g}", model.torque_drive
            yield Finding(
                f"{side} is about {shown:.3g} times that of the link, and N is 1, as for a {drive} at the link: if it "
                f"is that of the motor, the values are {size} times too small (--set N={size})",
                (side,),
            )
            return


def torque_of_link(model: Model, recording: Recording, settings: ParameterSettings | None) -> Iterator[Finding]:
    """Find a torque that is large for a motor, where the model takes it as that of the motor.

    Nothing in the motion tells on which side a torque was measured.
    """
    drive, given = model.torque_drive, {} if settings is None else settings.values
    at_motor = any(n in (*model.state_names, *model.input_names) for n in MOTOR)
    if drive != "torque" or not at_motor or not recording.measured(drive):
        return
    ratio = model.gear_ratio({**model.values(), **given})
    most = float(np.nanmax(np.abs(recording[drive])))
    if most * ratio > MOST_NM > most:
        yield Finding(
            f"{drive} reaches {most:.3g} Nm and is taken as that of the motor, which is {most * ratio:.3g} Nm behind "
            f"the gear: if it is that of the link, inertias, frictions and stiffnesses are {ratio:.4g} times too large "
            f"(--map {drive}={1.0 / ratio:.4g}*COLUMN)",
            (drive,),
        )


class _Other(NamedTuple):
    """That the motion shows another ratio than the model's, in words, and how that is known."""

    text: str
    exact: bool
    far: bool


def _other_ratio(model: Model, recording: Recording, settings: ParameterSettings) -> _Other | None:
    """Return that the motion shows another ratio than that of the model; None if it does not."""
    known = (*model.state_names, *model.input_names)
    side = next((n for n in MOTOR if n in known and recording.measured(n)), None)
    if side is None or LINK not in known or not recording.measured(LINK):
        return None
    try:
        start, free = settings.applied_to(model)
    except JointIdError:
        return None
    values = dict(zip(model.parameter_names, start.tolist(), strict=True))
    ratio, shown = model.gear_ratio(values), seen_ratio(recording, side)
    if shown is None or "N" not in values or "N" in free:
        return None
    exact = exact_ratio(recording)
    if exact is not None:
        shown = exact[0]
    off = abs(shown / ratio - 1.0)
    if off < SCALE if exact is None else off < max(OFF, SURE * exact[1] / abs(ratio)):
        return None
    digits = 3 if exact is None else 4
    column = f"the factor of the column (--map {side}={ratio / shown:.{digits}g}*COLUMN)"
    correct = column if shown < 0.0 else f"N (--set N={shown:.{digits}g}), or {column}"  # N is positive
    about = "about " if exact is None else ""
    text = f"{side} is {about}{shown:.{digits}g} times that of the link, and the gear ratio N is {ratio:.4g}"
    return _Other(f"{text}: correct {correct}", exact is not None, not 1.0 / FAR < shown / ratio < FAR)


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
