"""Estimators: objects whose fields are their options. Each takes a model and a recording and returns an `Estimate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, ClassVar, Protocol

from joint_id_core.arguments import require_type
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.estimators.hpinn.estimator import HPinn
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.options import Progress

if TYPE_CHECKING:
    from joint_id_core.data.recording import Recording
    from joint_id_core.estimators.together.fit import Together
    from joint_id_core.models import Model
    from joint_id_core.results.estimate import Estimate

__all__ = [
    "DEFAULT",
    "ESTIMATORS",
    "Estimator",
    "HPinn",
    "Innovations",
    "ParameterSettings",
    "Regression",
    "build",
    "fit",
    "fit_several",
]


class Estimator(Protocol):
    """Interface of an estimator: a frozen dataclass of options with a name and `fit`."""

    name: ClassVar[str]

    def fit(
        self,
        model: Model,
        recording: Recording,
        settings: ParameterSettings | None = None,
        progress: Progress | None = None,
    ) -> Estimate:
        """Fit a model to a recording."""

    def compile(self, model: Model, settings: ParameterSettings) -> None:
        """Compile all that fits of `model` need, or load it from the cache."""

    def is_compiled(self, model: Model, settings: ParameterSettings) -> bool:
        """Return whether `compile` only has to load."""


ESTIMATORS: dict[str, type[Innovations] | type[Regression] | type[HPinn]] = {
    kind.name: kind for kind in (Innovations, Regression, HPinn)
}
DEFAULT = Innovations()


def fit(
    model: Model,
    recording: Recording | Sequence[Recording],
    settings: ParameterSettings | None = None,
    estimator: Estimator = DEFAULT,
    progress: Progress | None = None,
) -> Estimate:
    """Fit a model to a recording.

    Args:
        model: from `models.build`, or your own model.
        recording: inputs and at least one measured state; or several recordings of one joint: see `fit_several`.
        settings: start values, fixed and freed parameters, priors; None takes the model's table as it is.
        estimator: `Innovations()`, `Regression()` or `HPinn()`, each with its own options.
        progress: called with a line of text from time to time.

    Returns:
        The estimate; one by `Innovations` is checked by `Regression`, where that suits the model. Poor data raise no
        exception: the status says what is wrong and what to do. Doubts about the recording end the notes.

    Raises:
        JointIdError: misuse of parameter names, values or options, or an argument of another type; a library that the
            estimator needs is missing.
    """
    require_types(model, recording, settings, estimator)
    if isinstance(recording, Sequence):
        return fit_several(model, recording, settings, estimator, progress).estimate
    from joint_id_core.estimators.shared.computed_load import computed  # loads NumPy

    if not computed(recording):
        return _fit(model, recording, settings, estimator, progress)
    return fit_several(model, [recording], settings, estimator, progress).estimate


def _fit(
    model: Model,
    recording: Recording,
    settings: ParameterSettings | None,
    estimator: Estimator,
    progress: Progress | None,
) -> Estimate:
    """Return the estimate of one recording, as if its load were measured."""
    from joint_id_core.estimators.checked import checked  # loads NumPy, as the next
    from joint_id_core.estimators.no_fit import no_fit
    from joint_id_core.estimators.regression_starts import started
    from joint_id_core.estimators.seen_ratio import torque_of_link, torque_of_motor
    from joint_id_core.estimators.shared.data_check import concerning, noted, refused
    from joint_id_core.estimators.shared.derived_inputs import without_bad_velocities
    from joint_id_core.estimators.shared.held_values import with_held_values
    from joint_id_core.estimators.shared.long_record import fitted_part, with_part

    found = concerning(model, recording)
    bad = refused(model, estimator.name, found, recording, settings)
    recording, found = without_bad_velocities(model, recording, found)
    for side in (torque_of_motor, torque_of_link):
        found = (*found, *side(model, recording, settings))
    whole, recording, given = recording, fitted_part(model, recording), settings
    if bad is None and isinstance(estimator, Innovations):
        bad = no_fit(model, estimator.name, recording, settings)
    if bad is not None:
        return bad
    if isinstance(estimator, Innovations):
        settings = started(model, recording, settings)
    estimate = estimator.fit(model, recording, settings, progress)
    if isinstance(estimator, Innovations):
        estimate, recording = checked(estimate, model, recording, given, settings, estimator, progress)
    if estimate.status.unusable:
        return estimate
    estimate = with_held_values(noted(estimate, found, model, recording), model, settings)
    return with_part(estimate, recording, whole)


def require_types(model: object, recording: object, settings: object, estimator: object) -> None:
    """Check the types of the arguments of `fit`.

    Raises:
        JointIdError: one is of another type; the message says how to make the right one.
    """
    from joint_id_core.data.recording import Recording
    from joint_id_core.models.base import Model

    several = recording if isinstance(recording, (list, tuple)) else [recording]
    wanted: list[tuple[str, object, type | tuple[type, ...], str]] = [
        ("model", model, Model, 'build("rigid_joint")'),
        *(("recording", one, Recording, 'read("motion.csv")') for one in several),
        ("settings", settings, (ParameterSettings, type(None)), 'ParameterSettings({"J": 2.0})'),
        ("estimator", estimator, tuple(ESTIMATORS.values()), "Regression()"),
    ]
    for what, value, kinds, how in wanted:
        require_type(what, value, kinds, f"make it with {how}")


def fit_several(
    model: Model,
    recordings: Sequence[Recording],
    settings: ParameterSettings | None = None,
    estimator: Estimator = DEFAULT,
    progress: Progress | None = None,
) -> Together:
    """Fit a model to several recordings of one joint: common physics; own start, noise and offsets.

    Args and errors: see `fit`.

    Returns:
        The estimate of all recordings, that of each by itself, and how far each is from all.
    """
    require_type("recordings", recordings, (list, tuple), 'give a list, such as [read("motion.csv")]')
    require_types(model, recordings, settings, estimator)
    from joint_id_core.estimators.loaded_fit import fitted_with_load  # loads NumPy, as the next
    from joint_id_core.estimators.shared.computed_load import computed
    from joint_id_core.estimators.together.fit import together

    def fitted(recording: Recording, chosen: ParameterSettings | None) -> Estimate:
        return _fit(model, recording, chosen, estimator, progress)

    if any(map(computed, recordings)):
        return fitted_with_load(model, recordings, settings, fitted)
    return together(model, [fitted(one, settings) for one in recordings], settings)


def build(name: str, **options: object) -> Innovations | Regression | HPinn:
    """Build the estimator called `name` with its options.

    Raises:
        JointIdError: unknown name, an option that this estimator does not have, a value outside its range.
    """
    if name not in ESTIMATORS:
        raise JointIdError(
            f"unknown estimator {name!r}{close_to(name, ESTIMATORS)}: choose one of {', '.join(ESTIMATORS)}"
        )
    known = {kind: [f.name for f in fields(ESTIMATORS[kind])] for kind in ESTIMATORS}
    for option in options:
        if option not in known[name]:
            others = [f"--estimator {kind}" for kind, own in known.items() if option in own]
            advice = f"or take {' or '.join(others)}" if others else f"or choose from {', '.join(known[name])}"
            raise JointIdError(f"estimator {name} has no option {option}: leave it out, {advice}")
    return ESTIMATORS[name](**options)  # type: ignore[arg-type]  # checked by the dataclass itself
