"""The estimate that is published between fits of whole windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.verdicts import findings, table, verdicts
from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.models import Model
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate, ParameterChange, Status

DISAGREE = "The newest samples disagree with what was known: the joint changes, or the model does not describe it."
FORGOTTEN = "The joint has changed: what was known is forgotten."


def published(
    model: Model,
    coordinates: Coordinates,
    last: Estimate,
    now: tuple[Array, Array],
    changes: tuple[ParameterChange, ...],
    fields: Mapping[str, Any],
) -> Estimate:
    """Return the estimate of the memory, with the findings of the last fit of a whole window, and these other `fields`.

    `now` are the coordinates (k,) and their covariance (k, k).
    """
    assert last.checks is not None
    z, covariance = coordinates.clip(now[0]), now[1]
    if any(last.checks.texts):  # what is likely but not significant in one window is no reason to widen
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
    return replace(
        last, status=Status.CONVERGED, message=message(notes), notes=notes,
        parameters=table(model, last.free, p, physical, rows, initial), covariance=physical,
        deviance=float("nan"), iterations=0, predictions=None, changes=changes, **fields,
    )  # fmt: skip


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


def forgotten(estimate: Estimate) -> Estimate:
    """Return the estimate of a window with which a memory begins in place of one that did not describe it."""
    notes = (estimate.notes[0], FORGOTTEN, *estimate.notes[1:])
    return replace(estimate, message=message(notes), notes=notes)


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
