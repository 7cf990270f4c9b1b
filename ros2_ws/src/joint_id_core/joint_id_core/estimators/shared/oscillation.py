"""The fastest oscillation of a model, which the samples have to show."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.models import Model
from joint_id_core.models.operations import ArrayOps

STEP = 1e-4  # of the typical size of a state
PER_PERIOD = 4.0  # samples; with fewer, an oscillation can hardly be told from a slower one


def fastest_oscillation(model: Model, values: Mapping[str, float]) -> float:
    """Return the frequency in Hz of the fastest oscillation of a model in motion; 0 if there is none.

    The model is linearised where all velocities are of typical size, so that friction has no steep slope.
    """
    scales = np.array([s.scale for s in model.states])
    at = np.array([s.scale if s.name.endswith("_velocity") else 0.0 for s in model.states])
    rows = at + STEP * np.vstack([np.diag(scales), -np.diag(scales)])  # (2 n, n)
    inputs = [np.zeros(len(rows)) for _ in model.inputs]
    count = len(scales)
    with np.errstate(all="ignore"):  # a regression may find that there is no inertia
        rates: Array = np.array(model.derivative(list(rows.T), inputs, SimpleNamespace(**values), ArrayOps()))
        jacobian = (rates[:, :count] - rates[:, count:]) / (2.0 * STEP * scales)
    if not np.isfinite(jacobian).all():
        return 0.0
    modes = np.linalg.eigvals(jacobian)
    return float(np.max(np.abs(modes.imag), where=np.abs(modes.imag) > np.abs(modes.real), initial=0.0)) / (2.0 * np.pi)


def slow_samples(model: Model, values: Mapping[str, float], rate: float) -> str:
    """Return a clause that says that `rate` in Hz is too low for the oscillation of a fitted model; else nothing."""
    fastest = fastest_oscillation(model, values)
    if rate >= PER_PERIOD * fastest:
        return ""
    return (
        f"by these values the joint oscillates at {fastest:.3g} Hz, and {rate:.4g} samples/s hardly show that: record "
        f"at {PER_PERIOD * fastest:.3g} Hz or more"
    )
