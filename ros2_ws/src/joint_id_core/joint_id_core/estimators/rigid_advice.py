"""What a regression of a rigid joint says of a bad fit of a flexible one: a late drive, or a gain that changes.

In the band of a regression both sides of a gear nearly move as one, so the gear does not matter for these.
"""

from __future__ import annotations

from dataclasses import replace

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.one_encoder import at_link
from joint_id_core.estimators.regression.changed_gain import changed_gain
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.models.rigid_joint import RigidJoint
from joint_id_core.results.estimate import Estimate, Status

BAD = (Status.POOR_FIT, Status.MAX_ITERATIONS)


def with_rigid_advice(
    estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings | None
) -> Estimate:
    """Return a bad estimate of a model with both sides of a gear, with that advice first; others as they are."""
    both = "motor_position" in model.state_names and "link_position" in model.state_names
    if estimate.status not in BAD or not both or not recording.measured(model.torque_drive or ""):
        return estimate
    from joint_id_core.estimators.regression.fit import regressed  # loads SciPy

    side = "motor" if recording.measured("motor_position") else "link"
    rigid = RigidJoint(gravity=model.has_gravity)
    try:
        joint = at_link(model, side, recording, settings or ParameterSettings())
        fitted = regressed(rigid, joint, ParameterSettings(), Regression())
    except JointIdError:
        return estimate
    told = next((text for f in fitted if (text := f.lag or changed_gain(f.samples))), "")
    if not told:
        return estimate
    notes = (sentence(told), *estimate.notes)
    return replace(estimate, notes=notes, message=message(notes))
