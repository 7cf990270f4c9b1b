"""Fit several models to one record and rank them by their predictions of held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from joint_id_core.arguments import require_type
from joint_id_core.comparison.model_text import Candidate, parse
from joint_id_core.comparison.ranking import Ranking, rank
from joint_id_core.comparison.trial import BLOCKS, Trial
from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.seen_ratio import wrong_ratio
from joint_id_core.estimators.shared.data_check import concerning, refused
from joint_id_core.estimators.shared.fit_data import MIN_SAMPLES, UnusableError, options_of, unusable
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import LAWS, Model
from joint_id_core.options import Progress
from joint_id_core.results.estimate import Estimate, Status
from joint_id_core.validation.prediction import HORIZON_S, held_out_drive_errors, held_out_errors

HELD_OUT_SHARE = 1 / 3
# One horizon for each block that is compared, and one more until the filter knows the state.
MIN_VALIDATION_S = (BLOCKS + 1) * HORIZON_S
# A part with less than this fraction of the other part's motion shows sensor noise rather than the joint.
STILL = 0.02
# Fractions of the model's smoothing velocity of Coulomb friction that a fit tries as well.
SHARPER = (0.1, 0.01)
# Decrease of the deviance from which a sharper step is better. If the joint never reverses, all steps give the same
# deviance except for rounding.
LEAST_GAIN = 0.01


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison: the ranking, the recording that was fitted and the one that was predicted."""

    ranking: Ranking
    fitted: Recording
    validated: Recording

    def __str__(self) -> str:
        """Return the report as a table in text."""
        from joint_id_core.comparison.report import table

        return table(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain JSON types."""
        from joint_id_core.comparison.report import as_dict

        return as_dict(self)


def compare(
    models: Sequence[str | Model | Candidate],
    recording: Recording,
    validation: Recording | None = None,
    held_out_share: float = HELD_OUT_SHARE,
    settings: ParameterSettings | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Fit every model to the first part of a record and predict the last one.

    Every friction law is tried with the smoothing velocity of the Coulomb step that suits it: the model's own or, if
    the likelihood is higher, a tenth or a hundredth of it. With too smooth a step, a law with more parameters would win
    because it can make the step steeper, whatever the joint does (docs/theory.md). Smoothing velocities in `settings`
    are not changed.

    Args:
        models: texts such as "rigid_joint:stribeck" (see `model_text.parse`) or models. Empty: every friction law of
            every model that fits the signals of the recording.
        recording: with `validation` all of it is fitted; else all but the last `held_out_share` of its samples, which
            are predicted.
        validation: another recording to predict.
        held_out_share: fraction of the samples, between 0 and 1.
        settings: as for `estimators.fit`; a candidate uses those for parameters that it has.
        progress: called with a line of text from time to time.

    Raises:
        JointIdError: misuse of parameter names or values (a name that no candidate has), a part too short, or motion in
            one part only. Candidates that cannot be fitted stay in the result, with the reason.
    """
    require_type("models", models, (list, tuple), 'give a list of models, such as ["rigid_joint:all"]')
    candidates, settings = parse(models, recording), settings or ParameterSettings()
    for name in settings.names:
        if not any(name in c.model.parameter_names for c in candidates):
            known = dict.fromkeys(n for c in candidates for n in c.model.parameter_names)
            raise JointIdError(f"no candidate has a parameter {name!r}: there are {', '.join(known)}")
    for c in candidates:  # report misuse before the first fit
        settings.of(c.model).applied_to(c.model)
    fitted, validated = (recording, validation) if validation is not None else split(recording, held_out_share)
    _require_motion(fitted, validated)
    tells = [_told(progress, f"{k} of {len(candidates)}, {c.label}: ") for k, c in enumerate(candidates, 1)]
    own = [settings.of(c.model) for c in candidates]
    estimates = [_fit(c, fitted, its, tell) for c, its, tell in zip(candidates, own, tells, strict=True)]
    plain = {c.model: e for c, e in zip(candidates, estimates, strict=True)}
    trials = []
    for c, its, tell, estimate in zip(candidates, own, tells, estimates, strict=True):
        found = _better(estimate, plain.get(_plain(c.model)), c, fitted, its, tell)
        tell("predicting")
        trials.append(_validated(c, found, validated))
    return Comparison(rank(trials), fitted, validated)


def _told(progress: Progress | None, head: str) -> Progress:
    """Return `progress` with a head before every line."""
    return lambda text: progress(head + text) if progress else None


def _plain(model: Model) -> Model:
    """Return the same model with the law that the other friction laws contain."""
    has_law = "friction" in options_of(model)
    return replace(model, friction=LAWS[0]) if has_law else model  # type: ignore[call-arg]  # it has the field


def _better(
    found: Estimate, plain: Estimate | None, c: Candidate, recording: Recording, settings: ParameterSettings,
    tell: Progress,
) -> Estimate:  # fmt: skip
    """Return the more likely of two fits of a law that contains the `plain` one: `found`, and one from plain's values.

    Laws with more parameters have more than one minimum on real records.
    """
    if plain is None or plain is found or not plain.converged or found.predictions is None:
        return found
    tell("again from the values of plain friction")
    start = {n: plain[n].value for n in plain.free if n in found.free}
    again = _fit(c, recording, settings.with_values(start), tell)
    return again if again.converged and again.deviance < found.deviance else found


def split(recording: Recording, held_out_share: float = HELD_OUT_SHARE) -> tuple[Recording, Recording]:
    """Split a recording into the first part, to fit, and the last `held_out_share` of its samples, to predict.

    Raises:
        JointIdError: a fraction that is not between 0 and 1, or too few samples to fit.
    """
    if not 0.0 < held_out_share < 1.0:
        raise JointIdError(f"held-out share = {held_out_share:g}: give a number between 0 and 1, e.g. 0.33")
    cut = len(recording) - round(held_out_share * len(recording))
    parts = recording.slice(0, cut), recording.slice(cut, len(recording))
    if len(parts[0]) < MIN_SAMPLES:
        raise JointIdError(
            f"{recording.source}: {len(parts[0])} samples are left to fit, a fit needs {MIN_SAMPLES}: record longer or "
            "hold a smaller share out"
        )
    return parts


def _require_motion(fitted: Recording, validated: Recording) -> None:
    """Check that the part to predict is long enough, and that not only one of the parts moves.

    Raises:
        JointIdError: if one of these does not hold.
    """
    lasts = len(validated) * validated.period if len(validated) > 1 else 0.0
    if lasts < MIN_VALIDATION_S or len(validated) < MIN_SAMPLES:
        raise JointIdError(
            f"{validated.source}: the part to predict holds {len(validated)} samples, {lasts:.3g} s of motion; to tell "
            f"models apart takes {MIN_SAMPLES} and {MIN_VALIDATION_S:g} s: record longer, hold a larger share out or "
            "validate on another recording"
        )
    names = [n for n in ("motor_position", "motor_velocity", "link_position", "link_velocity") if fitted.measured(n)]
    spread = {n: (_spread(fitted, n), _spread(validated, n)) for n in names if validated.measured(n)}
    for still, moving, part in ((0, 1, "fit"), (1, 0, "predict")):
        if spread and all(s[still] < STILL * s[moving] for s in spread.values()):
            said = ", ".join(f"{n} {s[still]:.2g} against {s[moving]:.2g}" for n, s in spread.items())
            raise JointIdError(
                f"{(fitted, validated)[still].source}: the joint hardly moves in the part to {part} (standard "
                f"deviations there and in the other part: {said}): choose --start and --end so that both parts move, "
                "or another recording to validate on"
            )


def _spread(recording: Recording, name: str) -> float:
    return float(np.nanstd(recording[name]))


def _fit(c: Candidate, recording: Recording, settings: ParameterSettings, tell: Progress) -> Estimate:
    """Fit a candidate, with a sharper Coulomb step as long as that increases the likelihood."""
    found = _fit_once(c, recording, settings, tell)
    smoothing = {n: found[n].value for n in c.model.smoothing.values() if n not in settings.names}
    if found.predictions is None or not smoothing:
        return found
    for share in SHARPER:
        tell(f"Coulomb step {1 / share:g} times as sharp")
        sharper = settings.with_values({n: share * w for n, w in smoothing.items()})
        other = _fit_once(c, recording, sharper, tell)
        if found.converged and not other.converged:
            continue
        if not other.deviance < found.deviance - LEAST_GAIN:
            break
        found = other
    return found


def _fit_once(c: Candidate, recording: Recording, settings: ParameterSettings, tell: Progress) -> Estimate:
    """Fit a candidate once; a fit that diverges returns a failed estimate."""
    bad = refused(c.model, "innovations", concerning(c.model, recording), recording, settings)
    bad = bad if bad is not None else wrong_ratio(c.model, "innovations", recording, settings)
    if bad is not None:
        return bad
    try:
        return fit_innovations(c.model, recording, settings, progress=tell)
    except (ArithmeticError, np.linalg.LinAlgError) as error:  # one candidate that diverges must not end the others
        diverged = UnusableError(Status.DIVERGED, f"{recording.source}: {Status.DIVERGED.advice} ({error})")
        return unusable(c.model, "innovations", diverged, recording, settings)


def _validated(c: Candidate, estimate: Estimate, recording: Recording) -> Trial:
    """Validate a candidate: return its trial with its prediction errors on the held-out part."""
    if estimate.predictions is None:
        return Trial(c, estimate, failure=f"{estimate.status.value}: {estimate.message}")
    try:
        errors = held_out_errors(c.model, recording, estimate)
        drive = held_out_drive_errors(c.model, recording, estimate)
    except JointIdError as error:
        return Trial(c, estimate, failure=f"could not be validated: {error}")
    errors |= dict([drive]) if drive else {}
    errors = {name: e for name, e in errors.items() if not np.isnan(e).all()}
    lost = [name for name, e in errors.items() if np.isinf(e).any()]
    if lost:
        return Trial(c, estimate, failure=f"could not be validated: its predictions of {', '.join(lost)} run away")
    if not errors:
        return Trial(c, estimate, failure=f"could not be validated: its labels do not change in {recording.source}")
    return Trial(c, estimate, errors, drive[0] if drive else "")
