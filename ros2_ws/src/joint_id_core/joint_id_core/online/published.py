"""The estimate that is published between fits of whole windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.verdicts import findings, table, verdicts
from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.models import Model
from joint_id_core.online.memory import Change
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate, ParameterChange, Status

DISAGREE = "The newest samples disagree with what was known: the joint changes, or the model does not describe it."
SHOWN = 3.0  # standard deviations by which a parameter must have changed to be named


def published(
    model: Model,
    last: Estimate,
    coordinates: Coordinates,
    now: tuple[Array, Array],
    window: SlidingWindow,
    white: Array | None,
    changes: tuple[ParameterChange, ...],
) -> Estimate:
    """Return the estimate of the memory, with the findings of the last fit of a whole window.

    `now` are the coordinates (k,) and their covariance (k, k).
    """
    assert last.checks is not None
    bias = 0.0 if last.checks.bias is None else last.checks.bias
    z, covariance = coordinates.clip(now[0] - bias), now[1]
    if any(last.checks.texts):  # a bias that is likely but not significant in one window is no reason to widen
        covariance = covariance + last.checks.excess
    rows = verdicts(model, last.free, covariance, coordinates, z, last.checks.together)
    slope = coordinates.slope(z)
    physical = covariance * np.outer(slope, slope)
    p = np.array(list(last.values.values()))
    index = [model.parameter_names.index(n) for n in last.free]
    p[index] = coordinates.values(z)
    initial = np.array([q.initial for q in last.parameters])
    said = [sentence(Status.CONVERGED.advice), *(c.text for c in changes)]
    notes = (*said, *findings(rows, last.checks.texts, 0))
    chi2 = last.chi2 if white is None else float(np.nanmean(white**2))
    return replace(
        last, status=Status.CONVERGED, message=message(notes), notes=notes,
        parameters=table(model, last.free, p, physical, rows, initial), covariance=physical, chi2=chi2,
        deviance=float("nan"), iterations=0, start=window.start, end=window.end, samples=len(window),
        predictions=None, changes=changes,
    )  # fmt: skip


def changes_of(
    free: tuple[str, ...],
    coordinates: Coordinates,
    change: Change,
    z: Array,
    covariance: Array,
    since: float,
    earlier: Mapping[str, ParameterChange],
) -> tuple[ParameterChange, ...]:
    """Return the changes of parameters, the most significant first: those that are significant, at least one.

    A parameter whose value had to be learned anew has not always changed: its new value may be the old one.
    A change that corrects an `earlier` one is told together with it.
    """
    before, after = coordinates.values(change.mean), coordinates.values(z)
    sigma = [
        coordinates.slope(at) * np.sqrt(np.diag(c)) for at, c in ((change.mean, change.covariance), (z, covariance))
    ]
    found = {}
    for j in (*change.names, *change.likely):
        name, after_ = free[j], (float(after[j]), float(sigma[1][j]))
        if j in change.names or abs(z[j] - change.mean[j]) > SHOWN * np.sqrt(
            covariance[j, j] + change.covariance[j, j]
        ):
            found[name] = ParameterChange(name, float(before[j]), float(sigma[0][j]), *after_, since)
    for name, old in earlier.items():
        j = free.index(name)
        found[name] = replace(old, after=float(after[j]), after_std_dev=float(sigma[1][j]))
    told = sorted(found.values(), key=_size, reverse=True)
    return tuple(c for c in told if c is told[0] or _size(c) > SHOWN)


def _size(change: ParameterChange) -> float:
    """Return a change in standard deviations of the difference."""
    return abs(change.after - change.before) / float(np.hypot(change.before_std_dev, change.after_std_dev))


def with_note(estimate: Estimate, window: SlidingWindow) -> Estimate:
    """Return the estimate of an earlier window as that of the present one, which the memory does not describe."""
    notes = (DISAGREE, *estimate.notes)
    return replace(
        estimate,
        status=Status.POOR_FIT,
        message=message(notes),
        notes=notes,
        start=window.start,
        end=window.end,
        predictions=None,
    )


def too_short(model: Model, window: SlidingWindow, needed_s: float) -> Estimate:
    """Return what is said before the first window in motion is complete."""
    recording = window.recording()
    text = (
        f"{recording.source}: the joint has moved for {window.duration:.2g} s, "
        f"a first estimate needs {needed_s:g} s of motion: move the joint"
    )
    return unusable(model, "innovations", UnusableError(Status.TOO_SHORT, text), recording)


def at_rest(model: Model, window: SlidingWindow) -> Estimate:
    """Return what is said of a joint that rests before its first estimate."""
    recording = window.recording()
    text = f"{recording.source}: {sentence('the joint rests in this window: move the joint')}"
    return unusable(model, "innovations", UnusableError(Status.NO_MOTION, text), recording)
