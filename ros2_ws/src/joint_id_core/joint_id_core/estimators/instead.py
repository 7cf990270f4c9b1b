"""A regression in place of innovations that do not describe the motion.

`innovations` predict every sample. Where the model lacks a load or a law of friction, or samples are late, they fail
by far, though inverse dynamics explain the torque in the band in which the joint moves: friction of a real robot is
known then, and its intervals reckon with what is left.
"""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.opinion import suits
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.fitted import SHIFTED
from joint_id_core.estimators.shared.mean_drive import CHANGES
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

BAD = (Status.POOR_FIT, Status.MAX_ITERATIONS, Status.DIVERGED)
SHOWN = "The residuals show"  # begins a note of what the model lacks
WHOSE = "this is a regression, since innovations do not describe every sample of the motion"


def regressed_instead(
    estimate: Estimate, model: Model, recording: Recording, settings: ParameterSettings | None
) -> Estimate | None:
    """Return a regression of a recording, to take the place of an estimate if it is better.

    None if the estimate is not bad, or a regression does not suit the model, the recording or the settings.
    """
    if estimate.status not in BAD or not suits(model) or (settings is not None and settings.priors):
        return None
    try:
        found = Regression().fit(model, recording, settings)
    except JointIdError:
        return None
    if found.status.unusable:
        return None
    why, *lacking = estimate.notes
    # What the model lacks, and what to try: a better model is better than another estimator.
    shown = [sentence(note.partition("; the standard deviations")[0].rstrip(".")) for note in lacking if SHOWN in note]
    # A drive that is late explains most of what the residuals show.
    first, rest = found.notes[:1], found.notes[1:]
    late = [note for note in rest if SHIFTED in note]
    others = [note for note in rest if note not in late]
    notes = (*first, *late, sentence(WHOSE), *shown, *others, f"Of innovations: {why[:1].lower()}{why[1:]}")
    return found.noted(notes, elapsed_s=estimate.elapsed_s + found.elapsed_s)


def changes_between(estimate: Estimate) -> bool:
    """Return whether the drive changes between two samples, which innovations can be told."""
    return any(CHANGES in note for note in estimate.notes)
