"""Estimators by name. Each takes a model and a recording and returns an `Estimate`."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from joint_id_core.errors import JointIdError
from joint_id_core.estimate import Estimate
from joint_id_core.estimators.innovations import InnovationsOptions, Progress, fit_innovations
from joint_id_core.models import Model
from joint_id_core.recording import Recording

ESTIMATORS = ("innovations", "hpinn")


def fit(
    model: Model,
    recording: Recording,
    values: Mapping[str, float] | None = None,
    fixed: Collection[str] = (),
    freed: Collection[str] = (),
    estimator: str = "innovations",
    progress: Progress | None = None,
    cell: str = "rk4",
) -> Estimate:
    """Fit `model` to `recording` with the estimator called `estimator`; `cell` as in `InnovationsOptions`.

    Raises:
        JointIdError: unknown estimator, misuse of parameter names or values.
    """
    if estimator == "innovations":
        return fit_innovations(model, recording, values, fixed, freed, InnovationsOptions(cell=cell), progress=progress)
    if estimator == "hpinn":
        if cell != "rk4":
            raise JointIdError(f"estimator hpinn has no {cell} cell: it is the paper's network of RK4 steps")
        from joint_id_core.estimators.hpinn import fit_hpinn  # needs torch, which is optional

        return fit_hpinn(model, recording, values, fixed, freed, progress=progress)
    raise JointIdError(f"unknown estimator {estimator!r}: choose one of {', '.join(ESTIMATORS)}")
