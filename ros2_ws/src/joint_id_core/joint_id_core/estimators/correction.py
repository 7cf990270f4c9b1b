"""Values corrected for what the model lacks, where that is beyond doubt: play, hysteresis, friction with a memory.

The other steps of a fit compare it with the recording, so they take the values that describe it best without these. The
corrected ones are nearer to the joint. Their intervals stay: that the bias is linear in what is lacking is not exact.
"""

from __future__ import annotations

import numpy as np

from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.misfit import CONTAINED
from joint_id_core.estimators.shared.intervals import widened
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate
from joint_id_core.results.verdict import Verdict

CORRECTED = "the values are corrected for it, and the standard deviations contain what it did to them"


def with_correction(estimate: Estimate, model: Model, settings: ParameterSettings | None) -> Estimate:
    """Return an estimate without the bias of what its checks found beyond doubt; others as they are.

    Args:
        estimate: by `Innovations`, whose standard deviations contain that bias.
        model, settings: what was fitted.
    """
    checks, free = estimate.checks, estimate.free
    if not estimate.converged or checks is None or checks.bias is None:
        return estimate
    coordinates = Coordinates(model, free, (settings or ParameterSettings()).priors)
    before = coordinates.z(np.array([estimate.values[n] for n in free]))
    z = coordinates.clip(before - checks.bias)
    scale = coordinates.slope(z) / coordinates.slope(before)
    covariance = estimate.covariance * np.outer(scale, scale)
    rows = {row.name: row for row in estimate.parameters}
    for name, value, sigma in zip(free, coordinates.values(z), np.sqrt(np.diag(covariance)), strict=True):
        row = rows[name].at(float(value), float(sigma))
        rows[name] = widened(model, row, row.std_dev) if row.verdict is Verdict.ESTIMATED else row
    notes = tuple(note.replace(CONTAINED, CORRECTED) for note in estimate.notes)
    return estimate.noted(notes, parameters=tuple(rows.values()), covariance=covariance)
