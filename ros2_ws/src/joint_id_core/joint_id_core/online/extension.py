"""Extend an estimate by new samples: one Gauss-Newton step on the new samples alone.

The previous estimate is the prior, so to first order the result equals an estimate from all samples together. This is
recursive prediction-error estimation (Ljung, System Identification, 2nd ed., ch. 11) with fixed noise levels.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from joint_id_core.cell.kernel import compile_model
from joint_id_core.data.recording import Array, Recording
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.innovations.gauss_newton import newton_step
from joint_id_core.estimators.innovations.recursion import Recursion
from joint_id_core.estimators.innovations.verdicts import explained, findings, table, verdicts
from joint_id_core.estimators.shared.fit_data import FitData, UnusableError, prepare
from joint_id_core.estimators.shared.initial_state import rough_states
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.substeps import steps_of
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate, Status

LONGEST_STEP = 4.0  # squared length of the step, in standard deviations, from which one linear step is not enough
UNLIKELY = 4.0  # standard deviations by which the mean squared innovation of new samples may exceed 1


def extend(
    model: Model,
    previous: Estimate,
    recording: Recording,
    settings: ParameterSettings,
    options: Innovations,
    inflation: float = 1.0,
) -> Estimate | None:
    """Extend a converged estimate.

    Args:
        model, settings, options: as for the fit of `previous`.
        previous: the estimate from the data before the new samples.
        recording: the new samples, preceded by a few older ones from which the filter learns the state of the joint.
        inflation: factor on the covariance of `previous` (forgetting).

    Returns:
        The estimate, for a window as long as that of `previous`. None if a full fit is needed: the new samples have
        other signals, show no motion, are not explained by the model, or change the estimate much.
    """
    begun = time.perf_counter()
    known = previous.values
    held = {n: v for n, v in known.items() if n not in previous.free}
    try:
        data = prepare(model, recording, settings.with_values(held))
    except UnusableError:
        return None
    first = int(np.searchsorted(data.time, previous.end, "right"))
    same = data.free == previous.free and set(data.noise_names) == set(previous.noise)
    if not same or previous.checks is None or first == len(data.time):
        return None
    coordinates = Coordinates(model, data.free, data.priors)
    belief = Belief.after(previous, coordinates, inflation)
    p = np.array([known[n] for n in model.parameter_names])
    recursion = Recursion(data, compile_model(model, "tanh", data.freed, options.cell), near=p)
    steps = steps_of(data, recursion.kernel, p, rough_states(data), previous.substeps)
    last = recursion.run(p[recursion.index], np.square([previous.noise[n] for n in data.noise_names]), steps)
    chi2 = _mean_square(data, last.residuals, first)
    if not np.isfinite(last.cost) or chi2 is None or explained(data, last.residuals).reasons:
        return None
    slope = coordinates.slope(belief.mean)
    matrix, gradient = recursion.since(last, first)
    precision, g = belief.precision + matrix * np.outer(slope, slope), gradient * slope
    step = newton_step(precision, g, coordinates.held(belief.mean, g))
    if not step @ precision @ step < LONGEST_STEP:
        return None
    z, covariance = coordinates.clip(belief.mean + step), np.asarray(np.linalg.inv(precision), dtype=float)
    rows = verdicts(model, data.free, covariance, coordinates, z, previous.checks.together)
    slope = coordinates.slope(z)
    physical = covariance * np.outer(slope, slope)
    initial = np.array([q.initial for q in previous.parameters])
    end = float(data.time[-1])
    notes = (sentence(Status.CONVERGED.advice), *findings(rows, previous.checks.texts, data.dropped))
    return replace(
        previous, message=message(notes), notes=notes,
        parameters=table(model, data.free, recursion.values(coordinates.values(z)), physical, rows, initial),
        covariance=physical, chi2=chi2, deviance=float("nan"), iterations=0, elapsed_s=time.perf_counter() - begun,
        start=previous.start + end - previous.end, end=end, predictions=None,
    )  # fmt: skip


def _mean_square(data: FitData, residuals: Array, first: int) -> float | None:
    """Return the mean squared innovation of the labels from `first` on; None if noise does not explain it."""
    count = int(np.count_nonzero(data.present[first:]))
    if not count:
        return None
    chi2 = float(np.sum(residuals[first:] ** 2)) / count
    return chi2 if chi2 < 1.0 + UNLIKELY * np.sqrt(2.0 / count) else None
