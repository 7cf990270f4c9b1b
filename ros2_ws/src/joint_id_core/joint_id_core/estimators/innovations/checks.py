"""Checks of a fit: torques that the model lacks, step size, residuals, predictions, inseparable parameters."""

from __future__ import annotations

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.drive_noise import drive_noise
from joint_id_core.estimators.innovations.estimator import MAX_SUBSTEPS
from joint_id_core.estimators.innovations.gauss_newton import Minimum
from joint_id_core.estimators.innovations.hidden_gear import hidden_gear
from joint_id_core.estimators.innovations.input_noise import sensor_bias, with_motion_noise
from joint_id_core.estimators.innovations.level_effect import effect_of_levels
from joint_id_core.estimators.innovations.misfit import misfit
from joint_id_core.estimators.innovations.noise import covariance_of_levels, unknown_levels
from joint_id_core.estimators.innovations.recursion import Pass
from joint_id_core.estimators.innovations.search import Outcome
from joint_id_core.estimators.innovations.sharpness import smoothing_bias
from joint_id_core.estimators.innovations.slow_parts import slow_parts
from joint_id_core.estimators.innovations.stages import STALLED, Stages
from joint_id_core.estimators.innovations.vanishing import of_vanishing
from joint_id_core.estimators.innovations.whiteness import memory
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.estimators.shared.free_run import free_runs, nrmse
from joint_id_core.estimators.shared.sentences import listed
from joint_id_core.estimators.shared.standing import not_known, standing
from joint_id_core.estimators.shared.substeps import fastest_mode
from joint_id_core.models.combinations import Combination, combinations
from joint_id_core.results.estimate import Checks
from joint_id_core.results.level_effect import LevelEffect

STIFF = 0.5  # |lambda h| from which the fastest mode, which the implicit cell damps, may be what RK4 cannot follow


def run_checks(outcome: Outcome) -> tuple[Checks, Array, Array, dict[str, Array]]:
    """Check the minimum that a search found.

    Returns:
        The findings; the covariance (k, k) of the coordinates with all that these and the noise levels add to it; the
        known bias of the coordinates (k,); and the predicted labels by name, each of shape (T,).
    """
    stages, found = outcome.stages, outcome.minimum
    data, recursion, coordinates = stages.data, stages.recursion, stages.coordinates
    last = recursion.renewed(found.last)
    missing, coloured = misfit(recursion, coordinates, found, last), memory(recursion, coordinates, found, last)
    slow = slow_parts(recursion, coordinates, found, last, bool(coloured.text))
    noisy, of_drive = with_motion_noise(recursion, found, last), np.zeros_like(found.hessian)
    bias = sensor_bias(noisy, coordinates, found, last)
    if not bias.any():  # else noise of the drive is in it
        of_drive = drive_noise(recursion, coordinates, found, last).excess
    held = standing(data)
    texts = (
        missing.text,
        not_known(held),
        _step_warning(stages, found),
        slow.text,
        coloured.text,
        outcome.warning,
        _stall_warning(found),
    )
    p, slope = stages.cost.values(found.z), coordinates.slope(found.z)
    of_noise, levels = _of_noise(stages, found, last)
    combined = {name for group in _combinations(data, p) for name in group.names}  # of them the combination is told
    excess = missing.excess + coloured.excess + slow.excess + outcome.scatter + smoothing_bias(stages, found)
    excess = excess + of_vanishing(stages.cost, found, combined)
    excess = excess + np.diag(np.where(np.isin(data.free, held), coordinates.spread**2, 0.0))
    covariance = of_noise + excess + of_drive + np.outer(bias, bias)
    together = in_combination(data, p, covariance * np.outer(slope, slope))
    predictions = free_runs(stages.kernel, data, last.states, p, last.steps, stages.options.horizon_s)
    return (
        Checks(
            texts, excess, nrmse(data, predictions), together, levels,
            missing.doubt or hidden_gear(recursion, coordinates, found, last, noisy) or slow.doubt, missing.lasting,
            missing.bias, slope * np.sqrt(np.diag(of_drive)), np.abs(slope * missing.of_gain),
        ),
        covariance,
        bias,
        predictions,
    )  # fmt: skip


def _of_noise(stages: Stages, found: Minimum, last: Pass) -> tuple[Array, LevelEffect]:
    """Return the covariance (k, k) of the coordinates by noise of estimated levels, and how it depends on them."""
    recursion = stages.recursion
    noise = recursion.noise_information(recursion.renewed(last), with_parameters=True)
    cross = noise.cross * stages.coordinates.slope_at(last.free)[:, None]
    of_levels = unknown_levels(found.inverse, noise.matrix, cross)
    levels = effect_of_levels(stages.cost, found, noise.matrix)
    wider = levels.wider(covariance_of_levels(noise.matrix), levels.information)
    return (found.covariance + of_levels) * np.outer(wider, wider), levels


def in_combination(data: FitData, p: Array, covariance: Array) -> dict[str, str]:
    """Return, by parameter that enters only in combination with others, what is known instead and what to do."""
    model, values = data.model, dict(zip(data.model.parameter_names, p.tolist(), strict=True))
    known: dict[str, str] = {}
    groups = _combinations(data, p)
    for group in sorted(groups, key=lambda group: -len(group.names)):  # smallest last: it says most of a parameter
        value = group.value(values, data.free, covariance)
        unit = f" {model.parameter(group.names[0]).unit}" if group.kind == "sum" else ""
        text = group.text if value is None else f"{group.text} = {value[0]:.6g} ± {value[1]:.2g}{unit}"
        known |= dict.fromkeys(group.names, _said(group, text))
    return known


def _combinations(data: FitData, p: Array) -> tuple[Combination, ...]:
    """Return the groups of parameters that enter only in combination, at the values `p` of all parameters (P,)."""
    model = data.model
    values = dict(zip(model.parameter_names, p.tolist(), strict=True))
    zero = {name for name, u in zip(model.input_names, data.u.T, strict=True) if not (u[0] or u.any())}
    zero |= {name for name in model.parameter_names if name not in data.free and values[name] == 0.0}
    return combinations(model, data.free, frozenset(zero))


def _said(group: Combination, text: str) -> str:
    """Return the advice for a group of parameters whose combination reads `text`."""
    if group.weights:
        hold = "one" if len(group.names) == 2 else "all but one"
        return f"this model shows only {text}: hold {hold} of these parameters"
    if len(group.names) == 1:
        return f"this model does not depend on {text}: hold it"
    shared = "the common scale of" if group.kind == "scale" else "more than a combination of"
    return f"no motion shows {shared} {listed(group.names)}: hold one of these parameters"


def _stall_warning(found: Minimum) -> str:
    """Return a warning if the iteration stalled, else an empty text."""
    if found.distance_left < STALLED:
        return ""
    return (
        f"likelihood and prediction errors ask for values {found.distance_left:.2g} standard deviations apart, as they "
        "do where the model lacks something; the standard deviations contain that distance"
    )


def _step_warning(stages: Stages, found: Minimum) -> str:
    """Return a warning if the integration error matters, else an empty text."""
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
    stiff = stages.options.cell == "rk4" and mode * stages.data.period > STIFF * found.substeps
    return text + ("; use the implicit cell (--cell implicit)" if stiff else "")
