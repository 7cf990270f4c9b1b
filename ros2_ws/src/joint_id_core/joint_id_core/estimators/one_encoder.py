"""Whether the motion of one side of a gear shows that the gear is flexible.

From one encoder the search takes whatever its white noise does not describe for an oscillation of the gear: on the EMPS
axis, `k_1` came out with a standard deviation of 0.4 %, for a mode that this motion does not excite.
"""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import across_gear, side_of
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.missing import COMPLIANCE
from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.models.rigid_joint import RigidJoint
from joint_id_core.results.estimate import Estimate, Status

# Share of the error of new samples that the compliance takes away from which the motion shows it. On a rigid joint the
# share scatters by 6 % in windows of 2 s; a motion that shows the gear has 40 to 80 %.
SHOWS = 0.2


def hides_compliance(
    model: Model, estimator: str, recording: Recording, settings: ParameterSettings | None
) -> Estimate | None:
    """Return the estimate where one side is measured and does not show the gear; None if it does, or may.

    That is asked of models that have both sides and a stiffness that is estimated without a prior of the user. The
    motion shows the gear if inverse dynamics of a rigid joint predict new samples better with its compliance.
    """
    settings = settings or ParameterSettings()
    side = _only_side(model, recording)
    if side is None or model.stiffness not in settings.applied_to(model)[1] or model.stiffness in settings.priors:
        return None
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    rigid = RigidJoint(gravity=model.has_gravity)
    try:
        fitted = regressed(rigid, at_link(model, side, recording, settings), ParameterSettings(), Regression())
    except JointIdError:
        return None
    if fitted[0].helps[COMPLIANCE] >= SHOWS:
        return None
    other = [n for n in model.state_names if side_of(n) not in (None, side)]
    text = (
        f"{recording.source}: only the {side} side is measured, and this motion does not show that the gear is "
        f"flexible: inverse dynamics of a rigid joint predict new samples as well. Record {' or '.join(other)}, "
        f"use model rigid_joint, or hold {model.stiffness} (--fix)"
    )
    return unusable(model, estimator, UnusableError(Status.MISSING_SIGNAL, text), recording, settings)


def _only_side(model: Model, recording: Recording) -> str | None:
    """Return the side of the gear on which alone there are measurements; None if there are both, or no drive.

    None as well for a voltage: there the current shows the motor, by the voltage that its motion makes.
    """
    sides = {side_of(n) for n in model.state_names} - {None}
    if len(sides) < 2 or model.stiffness is None or not recording.measured(model.torque_drive or ""):
        return None
    measured = {side_of(n) for n in model.state_names if recording.measured(n)} - {None}
    return measured.pop() if len(measured) == 1 else None


def at_link(model: Model, side: str, recording: Recording, settings: ParameterSettings) -> Recording:
    """Return a recording as a rigid joint would have it: motion and torques at the link."""
    p = dict(zip(model.parameter_names, settings.applied_to(model)[0].tolist(), strict=True))
    ratio, drive = model.gear_ratio(p), model.torque_drive or ""
    channels = {}
    for name in (n for n in model.state_names if side_of(n) == side and recording.measured(n)):
        at_link = name if side == "link" else across_gear(name) or ""
        channels[at_link] = recording[name] if side == "link" else recording[name] / ratio
    channels["torque"] = ratio * model.torque_constant(p) * recording[drive]
    if model.load in recording.channels:
        channels[model.load or ""] = recording[model.load or ""]
    return Recording(recording.time, channels, source=recording.source)
