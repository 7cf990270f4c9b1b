"""Tests of a fit: what the model lacks, residuals that remember, predictions ahead, what enters only together."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.estimator import MAX_SUBSTEPS
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.misfit import misfit
from joint_id_core.estimators.innovations.stages import STALLED, Stages
from joint_id_core.estimators.innovations.whiteness import memory
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.free_run import free_runs, nrmse
from joint_id_core.estimators.shared.substeps import fastest_mode
from joint_id_core.models.combinations import combinations
from joint_id_core.results.estimate import Checks


def check(stages: Stages, found: Minimum, alone: str) -> tuple[Checks, dict[str, Array]]:
    """Test a minimum; `alone` is what to say of one that only one start reached.

    Returns:
        What was found, and the predicted labels by name, each of shape (T,).
    """
    data, recursion, coordinates = stages.data, stages.recursion, stages.coordinates
    last = recursion.renewed(found.last)
    missing, coloured = misfit(recursion, coordinates, found, last), memory(recursion, coordinates, found, last)
    texts = (missing.text, coloured.text, _stall_warning(found), _step_warning(stages, found), alone)
    excess = missing.excess + coloured.excess
    p, slope = stages.cost.values(found.z), coordinates.slope(found.z)
    together = _combinations(data, p, (found.covariance + excess) * np.outer(slope, slope))
    predictions = free_runs(stages.kernel, data, last.states, p, last.steps, stages.options.horizon_s)
    return Checks(texts, excess, nrmse(data, predictions), together), predictions


def _combinations(data: FitData, p: Array, covariance: Array) -> dict[str, str]:
    """By parameter that enters only in combination, what is known instead."""
    model, values = data.model, dict(zip(data.model.parameter_names, p.tolist(), strict=True))
    zero = {name for name, u in zip(model.input_names, data.u.T, strict=True) if not (u[0] or u.any())}
    zero |= {name for name in model.parameter_names if name not in data.free and values[name] == 0.0}
    known: dict[str, str] = {}
    for group in combinations(model, data.free, frozenset(zero)):
        value = group.value(values, data.free, covariance)
        unit = f" {model.parameter(group.names[0]).unit}" if group.kind == "sum" else ""
        text = group.text if value is None else f"{group.text} = {value[0]:.6g} ± {value[1]:.2g}{unit}"
        known |= dict.fromkeys(group.names, text)
    return known


def _stall_warning(found: Minimum) -> str:
    """What to say of an iteration that stalled; nothing where it did not."""
    if found.distance_left < STALLED:
        return ""
    return (
        f"likelihood and prediction errors ask for values {found.distance_left:.1f} standard deviations apart, as they "
        "do where the model lacks something; the standard deviations contain that distance"
    )


def _step_warning(stages: Stages, found: Minimum) -> str:
    """What to say of an integration error that matters; nothing where it does not."""
    if 2 * found.substeps <= MAX_SUBSTEPS:
        return ""
    share = np.abs(found.integration) / np.sqrt(np.diag(found.inverse))
    matters = (np.abs(found.integration) > stages.least) & (share > 0.1)
    if not matters.any():
        return ""
    worst, p = int(np.argmax(share * matters)), stages.cost.values(found.z)
    mode = fastest_mode(stages.data, stages.kernel, p, stages.rough_states, sliding=False)
    text = (
        f"{found.substeps} steps a sample are too few: twice as many would move {stages.data.free[worst]} by "
        f"{share[worst]:.2g} standard deviations, which its own now contains (fastest mode {-mode:.4g} 1/s)"
    )
    return text + ("; use the implicit cell (--cell implicit)" if stages.options.cell == "rk4" else "")
