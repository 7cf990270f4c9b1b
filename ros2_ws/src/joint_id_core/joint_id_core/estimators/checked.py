"""A fit of a whole recording by innovations, with all that is looked at after it."""

from __future__ import annotations

from functools import partial

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.between_samples import described, fitted_between
from joint_id_core.estimators.constancy import with_constancy
from joint_id_core.estimators.correction import with_correction
from joint_id_core.estimators.cross_check import judged_whole
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.instead import changes_between, regressed_instead
from joint_id_core.estimators.late_signal import with_late_signal
from joint_id_core.estimators.narrowed import narrowed
from joint_id_core.estimators.opinion import second_opinion
from joint_id_core.estimators.seen_ratio import with_seen_ratio
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.signal_faults import with_signal_faults
from joint_id_core.models import Model
from joint_id_core.options import Progress
from joint_id_core.results.estimate import Estimate


def checked(
    estimate: Estimate,
    model: Model,
    recording: Recording,
    given: ParameterSettings | None,
    settings: ParameterSettings | None,
    estimator: Innovations,
    progress: Progress | None,
) -> tuple[Estimate, Recording]:
    """Return an estimate with what the checks say of it, or a better one, and the recording that it describes.

    Args:
        estimate: of the recording.
        model, recording: what was fitted.
        given: settings of the user; `settings`: the same with start values that were found.
        estimator, progress: with which it was made.
    """
    instead = regressed_instead(estimate, model, recording, given)
    # What a drive does between two samples can be told to innovations. If only that is lacking, a regression finds it.
    tells = instead is None or changes_between(instead)
    if instead is not None and instead.converged and not tells:
        return instead, recording
    again = partial(estimator.fit, model, settings=settings, progress=progress)
    near = partial(fit_innovations, model, settings=settings, options=estimator, progress=progress)
    estimate, share = fitted_between(estimate, model, recording, near) if tells else (estimate, 0.0)
    opinion = second_opinion(estimate, model, recording, given, share)
    estimate = estimate if opinion is None else judged_whole(estimate, model, opinion)
    recording = described(model, recording, share)
    late = with_late_signal(estimate, model, recording, again)
    in_time = late is estimate
    estimate = with_signal_faults(estimate, model, recording, settings) if in_time else late
    estimate = with_seen_ratio(estimate, model, recording, settings or ParameterSettings())
    estimate = with_constancy(estimate, model, recording, settings)
    estimate = narrowed(estimate, model, opinion) if opinion is not None and in_time else estimate
    return with_correction(estimate, model, settings), recording
