"""The estimate that is published between fits of whole windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from joint_id_core.cell.kernel import compile_shared
from joint_id_core.data.recording import Array, any_finite
from joint_id_core.estimators.innovations.belief import Coordinates
from joint_id_core.estimators.innovations.verdicts import findings, informative, table, verdicts
from joint_id_core.estimators.load_size import SIZE_ERROR, with_size_doubt
from joint_id_core.estimators.shared.computed_load import LOAD, with_doubt
from joint_id_core.estimators.shared.fit_data import UnusableError, unusable
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.online.agreement import Agreement
from joint_id_core.online.window import SlidingWindow
from joint_id_core.results.estimate import Estimate, ParameterChange, ParameterEstimate, Status, message

DISAGREE = "The newest samples disagree with what was known: the joint changes, or the model does not describe it."
UNKNOWN_S = 1.0  # after a gap the load of an arm is not known for up to 0.7 s
UNKNOWN_LOAD = "the load of the rest of the arm is not known: the diagnostics of the filter say what is missing"
FORGOTTEN = "The joint has changed: what was known is forgotten."


@dataclass(frozen=True)
class Said:
    """What is said in words of what is known.

    Attributes:
        status, notes, message: as in `Estimate`.
        rows: of all parameters, with values of that time.
        places: of the free parameters among these.
    """

    status: Status
    notes: tuple[str, ...]
    message: str
    rows: tuple[ParameterEstimate, ...]
    places: tuple[int, ...]


def said(
    model: Model,
    coordinates: Coordinates,
    last: Estimate,
    now: tuple[Array, Array],
    changes: tuple[ParameterChange, ...],
) -> Said:
    """Return in words what is known.

    Args:
        model, coordinates: what is identified.
        last: the newest fit of a whole window.
        now: coordinates (k,) and their covariance (k, k).
        changes: of the joint.
    """
    assert last.checks is not None
    z, covariance = coordinates.clip(now[0]), _with_excess(last, now[1])
    found = verdicts(model, last.free, covariance, coordinates, z, last.checks.together)
    status = Status.CONVERGED if informative(model, found) else Status.UNINFORMATIVE
    told = [sentence(status.advice), *(c.text for c in changes)]
    notes = (*told, *findings(found, last.checks.texts, 0))
    p = np.array(list(last.values.values()))
    initial = np.array([q.initial for q in last.parameters])
    names = [q.name for q in last.parameters]
    places = tuple(names.index(name) for name in last.free)
    return Said(status, notes, message(notes), table(model, last.free, p, covariance, found, initial), places)


def published(
    coordinates: Coordinates, last: Estimate, now: tuple[Array, Array], words: Said, fields: Mapping[str, Any]
) -> Estimate:
    """Return the estimate of the memory, with the findings of the last fit of a whole window, and these other `fields`.

    For `now` see `said`; `words` may be some samples older.
    """
    z, covariance = now[0], _with_excess(last, now[1])
    values, sigma, physical = np.empty_like(z), np.empty_like(z), np.empty_like(covariance)
    compile_shared().physical(
        z, covariance, coordinates.lower, coordinates.upper, coordinates.logarithm, values, sigma, physical
    )
    rows = list(words.rows)
    for k, value, std_dev in zip(words.places, values.tolist(), sigma.tolist(), strict=True):
        rows[k] = rows[k].at(value, std_dev)
    return last.updated(
        status=words.status, message=words.message, notes=words.notes, parameters=tuple(rows), covariance=physical,
        deviance=float("nan"), iterations=0, predictions=None, **fields,
    )  # fmt: skip


def _with_excess(last: Estimate, covariance: Array) -> Array:
    """Return the covariance of the coordinates, widened by what the checks of a window have found."""
    assert last.checks is not None
    # what is likely but not significant in one window is no reason to widen
    return covariance + last.checks.excess if any(last.checks.texts) else covariance


def with_note(estimate: Estimate, window: SlidingWindow) -> Estimate:
    """Return the estimate of an earlier window as that of the present one, which the memory does not describe."""
    notes = (DISAGREE, *(note for note in estimate.notes if note != sentence(Status.CONVERGED.advice)))
    return estimate.noted(notes, status=Status.POOR_FIT, start=window.start, end=window.end, predictions=None)


def forgotten(estimate: Estimate, agreement: Agreement) -> Estimate:
    """Return the estimate of a window with which a memory begins in place of one that did not describe it."""
    agreement.replaced()
    notes = (estimate.notes[0], FORGOTTEN, *estimate.notes[1:])
    return estimate.noted(notes)


def with_computed_load(estimate: Estimate, recent: SlidingWindow, model: Model) -> Estimate:
    """Return an estimate at the end of `recent` samples, with what it owes to a load that was computed, if any was."""
    if model.load is None or LOAD not in recent.derived:
        return estimate
    newest = recent.recording(recent.end - UNKNOWN_S)
    if estimate.status is not Status.NO_MOTION and not any_finite(newest[LOAD]):
        notes = (sentence(UNKNOWN_LOAD),)
        estimate = estimate.noted(notes, status=Status.MISSING_SIGNAL)
    return with_doubt(with_size_doubt(model, estimate, SIZE_ERROR), model)


def too_short(model: Model, window: SlidingWindow, needed_s: float, settings: ParameterSettings) -> Estimate:
    """Return what is said before the first window in motion is complete."""
    recording = window.recording()
    text = (
        f"{recording.source}: the joint has moved for {window.duration:.2g} s, "
        f"a first estimate needs {needed_s:g} s of motion: move the joint"
    )
    return unusable(model, "innovations", UnusableError(Status.TOO_SHORT, text), recording, settings)


def at_rest(model: Model, window: SlidingWindow, settings: ParameterSettings) -> Estimate:
    """Return what is said of a joint that rests before its first estimate."""
    newest = window.newest  # to join the samples of the window for every estimate would take long
    assert newest is not None
    text = f"{newest.source}: {sentence('the joint rests in this window: move the joint')}"
    found = unusable(model, "innovations", UnusableError(Status.NO_MOTION, text), newest, settings)
    return found.updated(start=window.start, end=window.end, samples=len(window))
