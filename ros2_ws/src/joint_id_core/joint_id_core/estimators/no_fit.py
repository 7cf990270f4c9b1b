"""Recordings of which a fit would tell nothing, and take long: what is wrong is told at once."""

from __future__ import annotations

from joint_id_core.data.recording import Recording
from joint_id_core.estimators.one_encoder import hides_compliance
from joint_id_core.estimators.seen_ratio import wrong_ratio
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate


def no_fit(model: Model, estimator: str, recording: Recording, settings: ParameterSettings | None) -> Estimate | None:
    """Return the estimate where the gear ratio is far off, or nothing shows that the gear yields; None elsewhere."""
    wrong = wrong_ratio(model, estimator, recording, settings)
    return wrong if wrong is not None else hides_compliance(model, estimator, recording, settings)
