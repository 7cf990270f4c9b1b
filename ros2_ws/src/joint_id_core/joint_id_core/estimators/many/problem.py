"""What many fits of one record start from: the fit of the engine."""

from __future__ import annotations

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


def physical(outcome: Outcome, z: Array, covariance: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Return coordinates and their standard deviations in physical units, by name."""
    at, names = outcome.stages.coordinates, outcome.stages.data.free
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * at.slope(z)
    return dict(zip(names, at.values(z).tolist(), strict=True)), dict(zip(names, deviation.tolist(), strict=True))
