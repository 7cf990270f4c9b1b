"""Estimators by name. Each takes a model and a recording and returns an `Estimate`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from joint_id_core.data.recording import Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.fit import fit_innovations
from joint_id_core.estimators.innovations.options import InnovationsOptions
from joint_id_core.estimators.innovations.stages import Progress
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

if TYPE_CHECKING:
    from joint_id_core.estimators.hpinn.fit import HPinnOptions

ESTIMATORS = ("innovations", "hpinn")


def fit(
    model: Model,
    recording: Recording,
    values: Mapping[str, float] | None = None,
    fixed: Collection[str] = (),
    freed: Collection[str] = (),
    estimator: str = "innovations",
    progress: Progress | None = None,
    options: InnovationsOptions | HPinnOptions | None = None,
) -> Estimate:
    """Fit `model` to `recording` with the estimator called `estimator` and, where given, its own options.

    Raises:
        JointIdError: unknown estimator, options of another one, misuse of parameter names or values.
    """
    if estimator == "innovations":
        if options is not None and not isinstance(options, InnovationsOptions):
            raise JointIdError(f"estimator innovations takes InnovationsOptions, not {type(options).__name__}")
        return fit_innovations(model, recording, values, fixed, freed, options, progress=progress)
    if estimator == "hpinn":
        from joint_id_core.estimators.hpinn.fit import HPinnOptions, fit_hpinn  # needs torch, which is optional

        if options is not None and not isinstance(options, HPinnOptions):
            raise JointIdError(f"estimator hpinn takes HPinnOptions, not {type(options).__name__}")
        return fit_hpinn(model, recording, values, fixed, freed, options, progress=progress)
    raise JointIdError(f"unknown estimator {estimator!r}: choose one of {', '.join(ESTIMATORS)}")
