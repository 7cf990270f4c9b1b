"""Fits of recordings of a joint whose load was computed: with the load as it is, or with one that suits the motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.load_size import with_size_doubt
from joint_id_core.estimators.matched_load import MatchedLoad
from joint_id_core.estimators.shared.computed_load import LOAD, with_doubt
from joint_id_core.estimators.shared.held_values import CONSTANT
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.together.fit import USABLE, Together, together
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

NOISY = 0.5  # share of a computed load (rms) that is noise to a fit, from which it is not described


def fitted_with_load(
    model: Model,
    recordings: Sequence[Recording],
    settings: ParameterSettings | None,
    fitted: Callable[[Recording, ParameterSettings | None], Estimate],
) -> Together:
    """Fit recordings of one joint; intervals contain what is not known of the load.

    Args:
        model, settings: of the fit.
        recordings: of the joint.
        fitted: fits one of them, with these settings.

    Raises:
        JointIdError: as `MatchedLoad` and `fitted`.
    """
    load = MatchedLoad(model, recordings, settings)

    def unmatched(chosen: ParameterSettings | None) -> Together:
        return together(model, [fitted(as_computed(one), chosen) for one in recordings], chosen)

    def finished(found: Together, as_fitted: Callable[[Recording], Recording]) -> Together:
        by_load = CONSTANT in found.estimate.free
        share = load.size_deviation(recordings, matched=as_fitted is not as_computed) if by_load else 0.0

        def doubtful(estimate: Estimate) -> Estimate:
            return with_doubt(with_size_doubt(model, estimate, share), model)

        alone = tuple(doubtful(one) for one in found.alone)
        return replace(found, estimate=doubtful(found.estimate), alone=alone, as_fitted=as_fitted)

    computed = unmatched(settings) if load.second_choice else None
    if computed is not None and _describes(computed, recordings):
        return finished(computed, as_computed)
    fits = [load.with_doubt(fitted(load.of(one), settings), k) for k, one in enumerate(recordings)]
    used = [k for k, one in enumerate(fits) if one.status in USABLE]
    if 0 < len(used) < len(fits):  # what is wrong with the others, as another payload, must not be in the load
        load = MatchedLoad(model, [recordings[k] for k in used], settings)
        for number, k in enumerate(used):
            fits[k] = load.with_doubt(fitted(load.of(recordings[k]), settings), number)
    found = together(model, fits, settings)
    if load.second_choice and found.estimate.status.describes:
        # A search that ended in a wrong minimum leaves a poor fit, too, and the matched load suits the start value of
        # the torque constant. Near these values the computed load may describe the motion after all.
        begun = {name: found.estimate[name].value for name in found.estimate.free}
        again = unmatched((settings or ParameterSettings()).with_values(begun))
        if _describes(again, recordings):
            return finished(again, as_computed)
    if computed is not None and computed.estimate.status.describes and not found.estimate.status.describes:
        return finished(computed, as_computed)
    if len(used) > 1:  # it is the same in all recordings, so they do not average it away
        found = replace(found, estimate=load.with_doubt(found.estimate))
    return finished(found, load.of)


def _describes(computed: Together, recordings: Sequence[Recording]) -> bool:
    """Return whether fits with the computed load describe the motion with it, and not by calling it noise."""
    used = [(fit, one) for fit, one in zip(computed.alone, recordings, strict=True) if fit.status in USABLE]
    return computed.estimate.status.describes and not any(_as_noise(fit, one) for fit, one in used)


def _as_noise(fit: Estimate, recording: Recording) -> bool:
    """Return whether most of the load of a recording is noise to a fit of it."""
    if LOAD not in recording:
        return False
    return fit.noise.get(f"input {LOAD}", 0.0) > NOISY * float(np.sqrt(np.nanmean(recording[LOAD] ** 2)))


def as_computed(recording: Recording) -> Recording:
    """Return a recording with its load as it was computed."""
    return recording.with_load_errors(None)
