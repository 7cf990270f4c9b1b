"""Continue from an earlier estimate of a joint: what it says of the joint now, or why it cannot be used.

An estimate becomes uncertain while nobody watches the joint: friction falls while joints warm up. This is a steady
drift of unknown size. So its standard deviation grows in proportion to the time that passed, by `DRIFT_PER_H`, and its
square is added to the variances. A random walk that reaches the same size after an hour would be 19 times
as wide after ten seconds.
"""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.innovations.estimator import Innovations
from joint_id_core.estimators.shared.fit_data import options_of
from joint_id_core.online.published import published, said
from joint_id_core.online.task import Task
from joint_id_core.results.estimate import Estimate, Status

DRIFT_PER_H = 0.1  # of a positive parameter, or of the prior standard deviation of another one
# Of the logarithm of a noise variance. Without it the first half second would set the levels: after restarts every
# 2 s, estimates were up to 7 standard deviations off.
NOISE_SIGMA = 0.3
SAME = 1e-9  # relative difference up to which two held values are the same


def known_of(task: Task, estimate: Estimate, gone_s: float) -> tuple[Array, Array]:
    """Return mean (k,) and covariance (k, k), in estimation coordinates, that an earlier estimate gives a memory.

    The excess of the checks is taken off, because every published estimate adds it.

    Args:
        task: of the identifier that continues.
        estimate: what was published of this joint.
        gone_s: time since then in s; inf if it is not known.

    Raises:
        JointIdError: the estimate is of another model or other settings, is no good one, or holds impossible numbers.
    """
    model, coordinates = task.model, task.coordinates
    _check_same(task, estimate)
    _check_numbers(estimate)
    assert estimate.checks is not None
    if not gone_s >= 0.0:
        raise JointIdError(f"a time of {gone_s:g} s since the estimate is impossible: give 0 or more, inf if unknown")
    for name in estimate.free:
        row, value = model.parameter(name), estimate.values[name]
        if not row.allows(value) or (row.positive and value <= 0.0):
            raise JointIdError(f"the estimate of {name}, {value:g} {row.unit}, is outside the bounds of the model")
    z = coordinates.z(np.array([estimate.values[n] for n in estimate.free]))
    scale = 1.0 / coordinates.slope(z)
    covariance = estimate.covariance * np.outer(scale, scale)
    if any(estimate.checks.texts):
        covariance = _without(covariance, estimate.checks.excess)
    drift = np.square(DRIFT_PER_H * gone_s / 3600.0 * coordinates.unit)
    room = np.maximum(0.0, np.square(coordinates.spread) - np.diag(covariance))
    return coordinates.clip(z), covariance + np.diag(np.minimum(drift, room))


def as_of_now(task: Task, known: tuple[Array, Array], estimate: Estimate) -> Estimate:
    """Return the estimate with the covariance and the verdicts of `known`, which `known_of` returned."""
    words = said(task.model, task.coordinates, estimate, known, estimate.changes)
    return published(task.coordinates, estimate, known, words, {"samples": 0})


def _check_same(task: Task, estimate: Estimate) -> None:
    """Raise an error that names the first difference between an estimate and what is to be identified now."""
    model, settings, estimator = task.model, task.settings, task.estimator
    assert isinstance(estimator, Innovations)
    values, free = settings.applied_to(model)
    pairs: list[tuple[str, object, object]] = [("model", estimate.model, model.name)]
    if estimate.model == model.name:
        now = options_of(model)
        pairs += [(n, estimate.model_options.get(n), now.get(n)) for n in sorted({*now, *estimate.model_options})]
        pairs += [("estimator", estimate.estimator, estimator.name), ("cell", estimate.cell, estimator.cell)]
        pairs += [("free parameters", list(estimate.free), list(free))]
        pairs += [("parameters", list(estimate.values), list(model.parameter_names))]
    for what, was, is_ in pairs:
        if was != is_:
            raise JointIdError(f"{what} was {_text(was)} and is {_text(is_)} now")
    for name, value in zip(model.parameter_names, values.tolist(), strict=True):
        if name not in free and not math.isclose(estimate.values[name], value, rel_tol=SAME):
            raise JointIdError(f"{name} was held at {estimate.values[name]:g} and is held at {value:g} now")


def _check_numbers(estimate: Estimate) -> None:
    """Raise an error if the estimate is no good one, or if one of its numbers cannot be true."""
    if estimate.status is not Status.CONVERGED or estimate.checks is None:
        raise JointIdError(f"the estimate is no good one: its status is {estimate.status.value}")
    count, checks = len(estimate.free), estimate.checks
    values = np.array([estimate.values[n] for n in estimate.free])
    noise = np.array(list(estimate.noise.values()))
    right = (
        np.shape(estimate.covariance) == np.shape(checks.excess) == (count, count)
        and all(np.isfinite(part).all() for part in (values, estimate.covariance, checks.excess, noise))
        and np.allclose(estimate.covariance, estimate.covariance.T)
        and bool(np.all(np.diag(estimate.covariance) > 0.0))
        and len(noise)
        and bool(np.all(noise > 0.0))
        and estimate.substeps >= 1
    )
    if not right or not _positive(estimate.covariance):
        raise JointIdError("the estimate holds numbers that cannot be true: it is damaged")


def _positive(matrix: Array) -> bool:
    """Return whether a symmetric matrix with a positive diagonal is positive definite."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    return bool(np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0] > 0.0)


def _without(covariance: Array, excess: Array) -> Array:
    """Return the covariance without the excess; with it where rounding leaves no positive definite matrix."""
    less = np.asarray(covariance - excess)
    return less if np.all(np.diag(less) > 0.0) and _positive(less) else covariance


def _text(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value) if value != "" else "not given"
