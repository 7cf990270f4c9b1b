"""What many fits of one record start from: the fit of the engine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.cell.kernel import compile_model, preparing
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.search import Outcome, Search
from joint_id_core.estimators.regression_starts import started
from joint_id_core.estimators.shared.fit_data import prepare
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.options import Progress


def searched(
    model: Model, recording: Recording, settings: ParameterSettings | None, options: Innovations, tell: Progress
) -> Outcome:
    """Return what the engine finds in a recording, with all that led to it.

    Raises:
        JointIdError: misuse of names or values, data that cannot be fitted, a fit that diverged.
    """
    data = prepare(model, recording, started(model, recording, settings), leave_out_rests=True)
    tell(preparing(model, "tanh", data.freed, options.cell))
    kernel = compile_model(model, "tanh", data.freed, options.cell)
    outcome = Search(data, kernel, options, None, tell).cold()
    if outcome is None or not outcome.minimum.definite:
        raise JointIdError(f"{recording.source}: the fit diverges from every start: look at the recording first")
    return outcome


@dataclass(frozen=True)
class Values:
    """A point in physical units: values (k,) and standard deviations (k,) of the free parameters."""

    values: Array
    std_dev: Array


def physical(outcome: Outcome, z: Array, covariance: Array) -> Values:
    """Return coordinates with their covariance in physical units."""
    at = outcome.stages.coordinates
    return Values(at.values(z), np.sqrt(np.maximum(np.diag(covariance), 0.0)) * at.slope(z))
