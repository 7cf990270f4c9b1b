"""The default estimator: the RK4-RNN with innovations feedback (prediction-error method).

Ljung, System Identification (2nd ed., ch. 7) for prediction-error estimation; the cell is the paper's RK4
cell with the previous label as one more input and the Kalman gain on it.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping

import numpy as np

from joint_id_core.codegen import compile_model
from joint_id_core.estimate import Checks, Estimate, ParameterEstimate, Status
from joint_id_core.estimators.belief import Belief
from joint_id_core.estimators.checks import check
from joint_id_core.estimators.gauss_newton import Minimum, stall_warning
from joint_id_core.estimators.innovations_options import InnovationsOptions
from joint_id_core.estimators.search import Progress, Search
from joint_id_core.identifiability import judge, verdicts
from joint_id_core.models import Model
from joint_id_core.problem import Problem, UnusableError, prepare, unusable
from joint_id_core.recording import Array, Recording
from joint_id_core.structure import combinations

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
    checks: Checks | None = None,
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
        checks: of a window that reached into this one, to be taken over; without them the fit is tested.
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
    held = {p.name for p in model.parameters if p.fixed}
    extra = tuple(n for n in problem.free if n in held)
    tell(f"preparing the compiled cell of {model.name}")
    search = Search.of(problem, compile_model(model, "tanh", extra, options.cell), options, belief, tell)
    found = search.warm(previous) if previous is not None and previous.converged else None
    if found is None:
        found, checks = search.cold(), None
    if found is None:
        diverged = UnusableError(Status.DIVERGED, f"{recording.source}: {Status.DIVERGED.advice}")
        return unusable(model, "innovations", diverged, recording)
    return _estimate(search, found, checks, begun)


def _combinations(problem: Problem, values: dict[str, float], covariance: Array) -> dict[str, str]:
    """By parameter that enters only in combination, what is known instead."""
    model = problem.model
    zero = {name for name, u in zip(model.input_names, problem.u.T, strict=True) if not (u[0] or u.any())}
    zero |= {name for name in model.parameter_names if name not in problem.free and values[name] == 0.0}
    known: dict[str, str] = {}
    for group in combinations(model, problem.free, frozenset(zero)):
        value = group.value(values, problem.free, covariance)
        unit = f" {model.parameter(group.names[0]).unit}" if group.kind == "sum" else ""
        text = group.text if value is None else f"{group.text} = {value[0]:.6g} ± {value[1]:.2g}{unit}"
        known |= dict.fromkeys(group.names, text)
    return known


def _estimate(search: Search, found: Minimum, checks: Checks | None, begun: float) -> Estimate:
    """Turn the minimum into an `Estimate`."""
    problem, model = search.problem, search.problem.model
    p = search.recursion.values(search.coordinates.values(found.z))
    predictions = None
    if checks is None:
        checks, predictions = check(search, found)
    covariance_z = found.covariance + checks.excess
    slope = search.coordinates.slope(found.z)
    covariance = covariance_z * np.outer(slope, slope)
    known = _combinations(problem, dict(zip(model.parameter_names, p.tolist(), strict=True)), covariance)
    rows = verdicts(model, problem.free, covariance_z, search.coordinates, found.z, known)
    std = dict(zip(problem.free, np.sqrt(np.diag(covariance)), strict=True))
    initial = dict(zip(model.parameter_names, problem.p, strict=True))
    parameters = tuple(
        ParameterEstimate(
            q.name,
            q.unit,
            float(v),
            float(std.get(q.name, np.nan)),
            rows[q.name].verdict,
            initial[q.name],
            rows[q.name].reason,
        )
        for q, v in zip(model.parameters, p, strict=True)
    )
    judged = judge(
        problem,
        found,
        checks.nrmse,
        rows,
        (*checks.texts, stall_warning(found), search.step_warning(found), search.alone),
        search.doubt,
    )
    noisy = (*problem.labels, *(f"input {n}" for n in model.input_names))
    sigma = np.sqrt(found.levels)
    return Estimate(
        model=model.name, estimator="innovations", status=judged.status, message=judged.message,
        parameters=parameters, free=problem.free, covariance=covariance, nrmse=checks.nrmse,
        noise=dict(zip(noisy, map(float, sigma), strict=True)),
        chi2=judged.residuals.chi2, whiteness=judged.residuals.whiteness,
        deviance=found.last.cost, observations=sum(map(len, problem.rows)),
        substeps=search.substeps, iterations=search.iterations,
        elapsed_s=time.perf_counter() - begun, start=float(problem.time[0]), end=float(problem.time[-1]),
        samples=len(problem.time), predictions=predictions,
        checks=checks, noise_information=search.scoring.known,
    )  # fmt: skip
