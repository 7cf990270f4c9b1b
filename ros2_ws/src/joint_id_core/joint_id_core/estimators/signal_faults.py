"""Faults of the signals behind a bad fit of a flexible joint: a late drive or encoder, another gain or gear ratio.

With both encoders the equation of the motor tells them. With one it takes a regression of a rigid joint: in its band
both sides of a gear nearly move as one, so the gear does not matter for a drive.
"""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.one_encoder import at_link
from joint_id_core.estimators.regression.changed_gain import changed_gain
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.models.rigid_joint import RigidJoint
from joint_id_core.results.estimate import Estimate, Status

BAD = (Status.POOR_FIT, Status.MAX_ITERATIONS, Status.DIVERGED)
ANGLES = ("motor_position", "link_position")


def with_signal_faults(
    estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings | None
) -> Estimate:
    """Return an estimate of a model with both sides of a gear with the fault first that explains why it is bad.

    One that converged, but whose residuals are not those of its model, is a poor fit if there is such a fault. So is
    one in which no parameter seems to show. Others stay as they are.
    """
    known = (*model.state_names, *model.input_names)
    drive = next((n for n in ("torque", "current") if n in known and recording.measured(n)), None)
    doubted = estimate.converged and estimate.checks is not None and any(estimate.checks.texts)
    doubted = doubted or estimate.status is Status.UNINFORMATIVE
    if not (estimate.status in BAD or doubted) or drive is None or not all(n in known for n in ANGLES):
        return estimate
    settings = settings or ParameterSettings()
    try:
        if all(recording.measured(n) for n in ANGLES):
            told = _of_both(estimate, model, recording, settings, drive)
        else:
            told = _of_rigid(model, recording, settings) if drive == model.torque_drive else ""
    except JointIdError:
        return estimate
    if not told:
        return estimate
    replaced = (sentence(told), sentence(estimate.status.advice) if doubted else "")
    others = [note for note in estimate.notes if note not in replaced]
    notes = (sentence(told), *([sentence(Status.POOR_FIT.advice)] if doubted else []), *others)
    return estimate.noted(notes, status=Status.POOR_FIT if doubted else estimate.status)


def _of_both(estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings, drive: str) -> str:
    from joint_id_core.estimators.regression.side_faults import side_fault  # loads SciPy

    values = dict(zip(model.parameter_names, settings.applied_to(model)[0].tolist(), strict=True))
    if estimate.status not in BAD:
        values |= estimate.values  # with the delays that were found
    if any(values.get(n or "") for n in (model.encoder_lag, model.drive_lag)):
        return ""  # the equation has no delays: what these explain it would take for a fault
    return side_fault(recording, drive, model.gear_ratio(values))


def _of_rigid(model: Model, recording: Recording, settings: ParameterSettings) -> str:
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    side = "motor" if recording.measured("motor_position") else "link"
    joint = at_link(model, side, recording, settings)
    fitted = regressed(RigidJoint(gravity=model.has_gravity), joint, ParameterSettings(), Regression())
    return next((text for f in fitted if (text := f.lag or changed_gain(f.samples))), "")
