"""This project: `estimators.fit`, which is told neither the noise of the labels nor that of the torque."""

from __future__ import annotations

from collections.abc import Mapping

from joint_id_core.cell.kernel import compile_model
from joint_id_core.estimators import ParameterSettings
from joint_id_core.estimators import fit as fit_model
from peers.model2 import FREE, MODEL, Data, Fit, processor_s


def fit(data: Data, start: Mapping[str, float], limit_s: float) -> Fit:
    """Fit from `start`; takes no notice of `limit_s`."""
    begun = processor_s()
    compile_model(MODEL, "tanh")
    built = processor_s()
    estimate = fit_model(MODEL, data.recording, ParameterSettings(start))
    seconds = processor_s() - built
    found = {name: estimate[name].value for name in FREE}
    return Fit(found, seconds, built - begun, estimate.iterations, estimate.converged)
