"""What the checks of a recording mean for a fit of a model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from joint_id_core.checking.finding import Finding
from joint_id_core.checking.findings import findings
from joint_id_core.data.recording import Recording
from joint_id_core.data.signals import integral_of
from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.estimators.shared.motor_constants import unequal_constants
from joint_id_core.estimators.shared.oscillation import slow_samples
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status


def concerning(model: Model, recording: Recording) -> tuple[Finding, ...]:
    """Return what is doubtful about the channels that a fit of this model uses, or should, fatal findings first."""
    used = {*model.state_names, *model.input_names}
    used |= {integral_of(n) or n for n in used if not recording.measured(n)}  # it is derived from there
    has_offset = "dtheta_0" in model.parameter_names
    found = (f for f in findings(recording) if f.concerns(used) and not (has_offset and f.about == "twist"))
    return (*found, *_unused_angle(model, recording))


def _unused_angle(model: Model, recording: Recording) -> Iterator[Finding]:
    """Find an encoder that a model without angles does not read, although it lacks the velocity that it shows."""
    for velocity in model.state_names:
        angle = integral_of(velocity)
        if angle is None or angle in model.state_names or recording.measured(velocity):
            continue
        if recording.measured(angle):
            yield Finding(
                f"{angle} is not used, as {model.name} has no angle: give its derivative as {velocity}, which shows "
                "more of the motor",
                (velocity,),
            )


def refused(
    model: Model,
    estimator: str,
    found: Sequence[Finding],
    recording: Recording,
    settings: ParameterSettings | None = None,
) -> Estimate | None:
    """Return the estimate for a recording with fatal findings; None if there are none."""
    fatal = [f.text for f in found if f.fatal]
    if not fatal:
        return None
    error = UnusableError(Status.BAD_DATA, f"{recording.source}: {fatal[0]}")
    return unusable(model, estimator, error, recording, settings)


def noted(estimate: Estimate, found: Sequence[Finding], model: Model, recording: Recording) -> Estimate:
    """Return an estimate with the findings after its first note, and with what its values say of the recording.

    A fault of the data explains most of what the other notes say of a fit.
    """
    texts = [f.text for f in found]
    if estimate.status in (Status.CONVERGED, Status.DISAGREE):
        texts += [slow_samples(model, estimate.values, 1.0 / recording.period), unequal_constants(model, estimate)]
    more = [sentence(text) for text in texts if text]
    if not more:
        return estimate
    if not estimate.notes:
        return replace(estimate, notes=tuple(more))
    notes = (*estimate.notes[:1], *more, *estimate.notes[1:])
    return estimate.noted(notes)
