"""The default estimator: the RK4-RNN with innovations feedback (prediction-error method).

Ljung, System Identification (2nd ed., ch. 7) for prediction-error estimation; the cell is the paper's RK4
cell with the previous label as one more input and the Kalman gain on it.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping

import numpy as np

from joint_id_core.codegen import compile_model
from joint_id_core.estimate import Estimate, Status
from joint_id_core.estimators.belief import Belief
from joint_id_core.estimators.checks import check
from joint_id_core.estimators.gauss_newton import Minimum
from joint_id_core.estimators.innovations_options import InnovationsOptions
from joint_id_core.estimators.search import Search
from joint_id_core.estimators.stages import Progress
from joint_id_core.identifiability import judge, table, verdicts
from joint_id_core.models import Model
from joint_id_core.problem import UnusableError, prepare, unusable
from joint_id_core.recording import Recording

DEFAULTS = InnovationsOptions()


def fit_innovations(
    model: Model,
    recording: Recording,
    values: Mapping[str, float] | None = None,
    fixed: Collection[str] = (),
    freed: Collection[str] = (),
    options: InnovationsOptions | None = None,
    belief: Belief | None = None,
    previous: Estimate | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Fit a model to a recording.

    Args:
        model: from `models.build`.
        recording: inputs and at least one measured state.
        values: start values (values of fixed parameters) that replace the nominal ones.
        fixed, freed: names to hold although the table frees them, and the other way round.
        belief: prior from earlier data; without it the start values with the spreads of the parameter table.
        previous: a converged estimate of the same joint to start from, without annealing (warm start).
        progress: called with a line of text now and then.

    Raises:
        JointIdError: misuse of names or values. Poor data come back as an `Estimate` with a status.
    """
    begun = time.perf_counter()
    options = options or DEFAULTS
    tell = progress or (lambda _: None)
    try:
        problem = prepare(model, recording, values, fixed, freed)
    except UnusableError as error:
        return unusable(model, "innovations", error, recording)
    tell(f"preparing the compiled cell of {model.name}")
    search = Search(problem, compile_model(model, "tanh", problem.freed, options.cell), options, belief, tell)
    found = search.warm(previous) if previous is not None and previous.converged else None
    found = found or search.cold()
    if found is None:
        diverged = UnusableError(Status.DIVERGED, f"{recording.source}: {Status.DIVERGED.advice}")
        return unusable(model, "innovations", diverged, recording)
    return _estimate(search, found, begun)


def _estimate(search: Search, found: Minimum, begun: float) -> Estimate:
    """Turn the minimum into an `Estimate`."""
    stages, coordinates, problem = search.stages, search.stages.coordinates, search.stages.problem
    model, p = problem.model, stages.cost.values(found.z)
    checks, predictions = check(stages, found, search.alone)
    covariance_z = found.covariance + checks.excess
    slope = coordinates.slope(found.z)
    covariance = covariance_z * np.outer(slope, slope)
    rows = verdicts(model, problem.free, covariance_z, coordinates, found.z, checks.together)
    judged = judge(problem, found, checks.nrmse, rows, checks.texts, search.doubt)
    sigma = np.sqrt(found.levels)
    return Estimate(
        model=model.name, estimator="innovations", status=judged.status, message=judged.message,
        parameters=table(model, problem.free, p, covariance, rows, problem.p),
        free=problem.free, covariance=covariance, nrmse=checks.nrmse,
        noise=dict(zip(problem.noise_names, map(float, sigma), strict=True)),
        chi2=judged.residuals.chi2, whiteness=judged.residuals.whiteness,
        deviance=found.last.cost, observations=sum(map(len, problem.rows)),
        substeps=stages.substeps, iterations=stages.iterations,
        elapsed_s=time.perf_counter() - begun, start=float(problem.time[0]), end=float(problem.time[-1]),
        samples=len(problem.time), predictions=predictions,
        checks=checks,
    )  # fmt: skip
