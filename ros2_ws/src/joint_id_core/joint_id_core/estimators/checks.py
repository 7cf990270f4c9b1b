"""Tests of a fit: what the model lacks, residuals that remember, predictions ahead, what enters only together."""

from __future__ import annotations

import numpy as np

from joint_id_core import prediction
from joint_id_core.estimate import Checks
from joint_id_core.estimators.gauss_newton import Minimum
from joint_id_core.estimators.innovations_options import MAX_SUBSTEPS
from joint_id_core.estimators.memory import memory
from joint_id_core.estimators.misfit import misfit
from joint_id_core.estimators.stages import FAR, Stages
from joint_id_core.estimators.substeps import fastest_mode
from joint_id_core.problem import Problem
from joint_id_core.recording import Array
from joint_id_core.structure import combinations


def check(stages: Stages, found: Minimum, alone: str) -> tuple[Checks, dict[str, Array]]:
    """Test a minimum; `alone` is what to say of one that only one start reached.

    Returns:
        What was found, and the predicted labels by name, each of shape (T,).
    """
    problem, recursion, coordinates = stages.problem, stages.recursion, stages.coordinates
    last = recursion.renewed(found.last)
    missing, coloured = misfit(recursion, coordinates, found, last), memory(recursion, coordinates, found, last)
    texts = (missing.text, coloured.text, _stall_warning(found), _step_warning(stages, found), alone)
    excess = missing.excess + coloured.excess
    p, slope = stages.cost.values(found.z), coordinates.slope(found.z)
    together = _combinations(problem, p, (found.covariance + excess) * np.outer(slope, slope))
    predictions = prediction.free_runs(stages.kernel, problem, last.states, p, last.steps, stages.options.horizon_s)
    return Checks(texts, excess, prediction.nrmse(problem, predictions), together), predictions


def _combinations(problem: Problem, p: Array, covariance: Array) -> dict[str, str]:
    """By parameter that enters only in combination, what is known instead."""
    model, values = problem.model, dict(zip(problem.model.parameter_names, p.tolist(), strict=True))
    zero = {name for name, u in zip(model.input_names, problem.u.T, strict=True) if not (u[0] or u.any())}
    zero |= {name for name in model.parameter_names if name not in problem.free and values[name] == 0.0}
    known: dict[str, str] = {}
    for group in combinations(model, problem.free, frozenset(zero)):
        value = group.value(values, problem.free, covariance)
        unit = f" {model.parameter(group.names[0]).unit}" if group.kind == "sum" else ""
        text = group.text if value is None else f"{group.text} = {value[0]:.6g} ± {value[1]:.2g}{unit}"
        known |= dict.fromkeys(group.names, text)
    return known


def _stall_warning(found: Minimum) -> str:
    """What to say of an iteration that stalled; nothing where it did not."""
    if found.distance_left < FAR:
        return ""
    return (
        f"likelihood and prediction errors ask for values {found.distance_left:.1f} standard deviations apart, as they "
        "do where the model lacks something; the standard deviations contain that distance"
    )


def _step_warning(stages: Stages, found: Minimum) -> str:
    """What to say of an integration error that matters; nothing where it does not."""
    if 2 * stages.substeps <= MAX_SUBSTEPS:
        return ""
    share = np.abs(found.integration) / np.sqrt(np.diag(found.inverse))
    matters = (np.abs(found.integration) > stages.least) & (share > 0.1)
    if not matters.any():
        return ""
    worst, p = int(np.argmax(share * matters)), stages.cost.values(found.z)
    mode = fastest_mode(stages.problem, stages.kernel, p, stages.rough_states, sliding=False)
    text = (
        f"{stages.substeps} steps a sample are too few: twice as many would move {stages.problem.free[worst]} by "
        f"{share[worst]:.2g} standard deviations, which its own now contains (fastest mode {-mode:.4g} 1/s)"
    )
    return text + ("; use the implicit cell (--cell implicit)" if stages.options.cell == "rk4" else "")
