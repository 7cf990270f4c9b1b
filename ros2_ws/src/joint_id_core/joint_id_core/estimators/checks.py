"""Tests of a fit: what the model lacks, residuals that remember, and predictions ahead of the data."""

from __future__ import annotations

from joint_id_core import prediction
from joint_id_core.estimate import Checks
from joint_id_core.estimators.gauss_newton import Minimum
from joint_id_core.estimators.memory import memory
from joint_id_core.estimators.misfit import misfit
from joint_id_core.estimators.search import Search
from joint_id_core.recording import Array


def check(search: Search, found: Minimum) -> tuple[Checks, dict[str, Array]]:
    """Test the minimum that a search found.

    Returns:
        What was found, and the predicted labels by name, each of shape (T,).
    """
    problem, recursion, coordinates = search.problem, search.recursion, search.coordinates
    last = recursion.renewed(found.last)
    missing, coloured = misfit(recursion, coordinates, found, last), memory(recursion, coordinates, found, last)
    p = recursion.values(coordinates.values(found.z))
    predictions = prediction.free_runs(search.kernel, problem, last.states, p, last.steps, search.options.horizon_s)
    texts, nrmse = (missing.text, coloured.text), prediction.nrmse(problem, predictions)
    return Checks(texts, missing.excess + coloured.excess, nrmse, float(problem.time[-1])), predictions
