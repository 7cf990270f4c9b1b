"""The default estimator: the RK4-RNN with innovations feedback (prediction-error method).

See Ljung, System Identification (2nd ed., ch. 7) for prediction-error estimation. The cell is the paper's RK4 cell with
one more input: the previous label, weighted by the Kalman gain.
"""

from __future__ import annotations

import time
from collections.abc import Collection

import numpy as np

from joint_id_core.cell.kernel import compile_model, preparing
from joint_id_core.data.recording import Recording
from joint_id_core.estimators.innovations.belief import Belief
from joint_id_core.estimators.innovations.checks import run_checks
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.prior_pull import prior_pull
from joint_id_core.estimators.innovations.search import Outcome, Search
from joint_id_core.estimators.innovations.verdicts import Judgement, judge, table, verdicts
from joint_id_core.estimators.shared.fit_data import UnusableError, options_of, origin_of, prepare, unusable
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.options import Progress
from joint_id_core.results.estimate import Estimate, Status

DEFAULTS = Innovations()


def fit_innovations(
    model: Model,
    recording: Recording,
    settings: ParameterSettings | None = None,
    options: Innovations = DEFAULTS,
    belief: Belief | None = None,
    previous: Estimate | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Fit a model to a recording.

    Args:
        model: from `models.build`.
        recording: inputs and at least one measured state.
        settings: values, fixed and freed parameters, priors.
        options: the estimator with its options.
        belief: prior from earlier data; None takes the start values with the spreads of the parameter table.
        previous: a converged estimate of the same joint to start from, without annealing (warm start).
        progress: called with a line of text from time to time.

    Raises:
        JointIdError: misuse of names or values. Poor data come back as an `Estimate` with a status.
    """
    begun = time.perf_counter()
    tell = progress or (lambda _: None)
    try:
        data = prepare(model, recording, settings, leave_out_rests=True)
    except UnusableError as error:
        return unusable(model, "innovations", error, recording, settings)
    tell(preparing(model, "tanh", data.freed, options.cell))
    search = Search(data, compile_model(model, "tanh", data.freed, options.cell), options, belief, tell)
    outcome = search.warm(previous) if previous is not None and previous.converged else None
    outcome = outcome or search.cold()
    if outcome is None or not outcome.minimum.definite:
        diverged = UnusableError(Status.DIVERGED, f"{recording.source}: {Status.DIVERGED.advice}")
        return unusable(model, "innovations", diverged, recording, settings)
    return estimate_of(outcome, begun)


def estimate_of(outcome: Outcome, begun: float) -> Estimate:
    """Convert the minimum that was found to an `Estimate`."""
    stages, found = outcome.stages, outcome.minimum
    coordinates, data = stages.coordinates, stages.data
    checks, covariance_z, bias, predictions = run_checks(outcome)
    z = coordinates.clip(found.z - bias)
    model, p = data.model, stages.cost.values(z)
    slope = coordinates.slope(z)
    covariance = covariance_z * np.outer(slope, slope)
    rows = verdicts(model, data.free, covariance_z, coordinates, z, checks.together)
    doubts = tuple(filter(None, (outcome.doubt, checks.doubt)))

    def judged_with(priors: Collection[str]) -> Judgement:
        """Judge the fit, and tell which of these priors it fights."""
        pull = prior_pull(model, data.free, coordinates, stages.cost.belief, z, found.inverse, priors)
        return judge(data, found, checks.nrmse, rows, (pull, *checks.texts), doubts)

    judged = judged_with(data.free)
    if judged.status is Status.POOR_FIT:
        # Such a model may ask for any value: that asks for no other start, but a narrow prior may be why it is poor.
        judged = judged_with(data.priors)
    sigma = np.sqrt(found.levels)
    return Estimate(
        model=model.name, estimator="innovations", status=judged.status, message=judged.message,
        parameters=table(model, data.free, p, covariance, rows, data.p),
        free=data.free, covariance=covariance, nrmse=checks.nrmse,
        noise=dict(zip(data.noise_names, map(float, sigma), strict=True)),
        chi2=judged.residuals.chi2, whiteness=judged.residuals.whiteness,
        deviance=found.last.cost, observations=sum(map(len, data.rows)),
        substeps=found.substeps, iterations=stages.effort.iterations,
        elapsed_s=time.perf_counter() - begun, start=float(data.time[0]), end=float(data.time[-1]),
        samples=len(data.time), model_options=options_of(model), cell=stages.options.cell,
        predictions=data.predictions(predictions, stages.options.horizon_s), checks=checks, notes=judged.notes,
        **origin_of(data.recording),
    )  # fmt: skip
