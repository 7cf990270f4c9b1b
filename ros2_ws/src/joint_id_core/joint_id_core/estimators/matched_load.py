"""A computed load that is matched to the motion, as far as the bodies of its description may be off.

A load that is wrong by a part of a percent of its masses is taken for friction and inertia, and one that is wrong by
some percent leaves a poor fit. So what it may be off by (`arm.load_errors`) is fitted to the recording beside the
parameters, with the widths of its prior. Least squares with more columns give, for the parameters, what they give
without them for the load that was found, and a covariance that is larger by what is not known of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.computed_load import LOAD
from joint_id_core.estimators.shared.intervals import with_covariance
from joint_id_core.estimators.shared.long_record import fitted_part
from joint_id_core.estimators.shared.sentences import message, sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

TINY = 1e-300
ROUNDS = 5  # in which the noise is found
TOLD = 0.1  # rms of what was added to the load, over that of the load, from which it is told
FAR = 4.0  # standard deviations of its prior from which more is wrong than masses


@dataclass(frozen=True)
class _Seen:
    """What one recording says of the factors of the errors, beside parameters of its own.

    Attributes:
        names: of the k parameters.
        moves: what one unit of each error changes of them, shape (k, m).
        information, vector: on the factors, shapes (m, m) and (m,).
    """

    names: tuple[str, ...]
    moves: Array
    information: Array
    vector: Array


class MatchedLoad:
    """The load that suits the motion of recordings of one joint.

    If nothing is told of its errors, or the regression does not suit the model or the recordings, it is the computed
    one.

    Args:
        model, settings: as of `estimators.fit`.
        recordings: of the joint.

    Raises:
        JointIdError: the loads are by different descriptions.
    """

    def __init__(self, model: Model, recordings: Sequence[Recording], settings: ParameterSettings | None) -> None:
        self._model = model
        _require_one([one.load_errors.of for one in recordings if one.load_errors is not None])
        self._seen = [_seen(model, recording, settings) for recording in recordings]
        known = [seen for seen in self._seen if seen is not None]
        self._factors: Array | None = None
        if known:
            self._covariance = np.linalg.inv(sum(one.information for one in known) + np.eye(len(known[0].vector)))
            self._factors = self._covariance @ sum(one.vector for one in known)
        self._share = max((self._share_of(recording) for recording in recordings), default=0.0)

    def of(self, recording: Recording) -> Recording:
        """Return a recording with this load; it may be another one of the joint."""
        errors, bare = recording.load_errors, replace(recording, load_errors=None)
        if errors is None or self._factors is None:
            return bare
        return bare.with_channels({LOAD: recording[LOAD] + errors.at(recording.time) @ self._factors}, derived=True)

    def _share_of(self, recording: Recording) -> float:
        """Return the rms of what is added to the load, over that of the load."""
        if self._factors is None or recording.load_errors is None:
            return 0.0
        load = recording[LOAD]
        added = self.of(recording)[LOAD] - load
        return float(np.sqrt(np.nanmean(added**2) / (np.nanmean(load**2) + TINY)))

    def with_doubt(self, estimate: Estimate, number: int | None = None) -> Estimate:
        """Return an estimate of the recording with this number, or of all, with what is not known of the load."""
        used = [one for one in (self._seen if number is None else self._seen[number : number + 1]) if one is not None]
        if not used or not estimate.free or estimate.status.unusable:
            return estimate
        names = [name for name in used[0].names if name in estimate.free]
        own, here = [used[0].names.index(n) for n in names], [estimate.free.index(n) for n in names]
        moves = np.mean([one.moves for one in used], axis=0)[own]
        covariance = estimate.covariance.copy()
        covariance[np.ix_(here, here)] += moves @ self._covariance @ moves.T
        return self._told(with_covariance(self._model, estimate, covariance))

    def _told(self, estimate: Estimate) -> Estimate:
        """Return an estimate that tells how far the load is from the computed one, if it is far."""
        if self._factors is None or self._share < TOLD:
            return estimate
        why = "masses of the description or the torque constant are off"
        if np.abs(self._factors).max() > FAR:
            why = "more than masses of the description is off, perhaps a tool is missing"
        said = (
            f"the load was matched to the motion, by {100.0 * self._share:.0f} % of it: {why} (joint-id arm fit --out "
            "writes a description that suits)"
        )
        notes = (*estimate.notes, sentence(said))
        return replace(estimate, notes=notes, message=message(notes))


def _require_one(loads: Sequence[str]) -> None:
    if len(set(loads)) > 1:
        raise JointIdError(f"{' and '.join(dict.fromkeys(loads))}: fit recordings with one description of one joint")


def _seen(model: Model, recording: Recording, settings: ParameterSettings | None) -> _Seen | None:
    """Return what a recording says of the errors of its load; None if it says nothing."""
    errors = recording.load_errors
    if errors is None or model.load != LOAD or LOAD not in recording:
        return None
    from joint_id_core.estimators.regression.equations import equations  # loads SciPy, as the next
    from joint_id_core.estimators.regression.estimator import Regression
    from joint_id_core.estimators.regression.fit import suits
    from joint_id_core.estimators.regression.prepared import prepared
    from joint_id_core.estimators.regression.signals import all_smoothed, at_samples
    from joint_id_core.estimators.shared.fit_data import prepare

    if not suits(model):
        return None
    try:
        data = prepare(model, fitted_part(model, recording), settings, leave_out_rests=True)
        ready = prepared(data, Regression())
    except JointIdError:
        return None
    found = next((e for e in equations(ready.model, ready.moved, ready.values, ready.free) if e.factor), None)
    if found is None:
        return None
    samples, _ = ready.compared(found)
    torques = np.array([at_samples(column) for column in errors.at(ready.time).T]).T
    table = all_smoothed(ready.time, {LOAD: torques}, ready.usable, ready.band_hz)[LOAD][samples.rows.index]
    seen = np.any(samples.columns != 0.0, axis=0)
    columns = samples.columns[:, seen]
    moves = np.zeros((len(found.names), table.shape[1]))
    moves[seen] = np.linalg.lstsq(columns, table, rcond=None)[0]
    beside = table - columns @ moves[seen]
    noise = _noise(samples.y, columns, beside, samples.rows.pieces)
    return _Seen(found.names, moves, beside.T @ beside / noise, beside.T @ samples.y / noise)


def _noise(y: Array, columns: Array, errors: Array, pieces: NDArray[np.int64]) -> float:
    """Return the variance of white noise that would leave the parameters as uncertain as what is left of y (R,).

    That has a memory. Errors (R, m), with a normal factor each, are what columns (R, k) do not explain of them.
    """
    from joint_id_core.estimators.regression.covariance import automatic_lag, newey_west

    white = np.diag(np.linalg.pinv(columns.T @ columns))
    residuals = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    left = residuals
    for _ in range(ROUNDS):
        lag = automatic_lag(columns * left[:, None])
        noise = float(np.median(np.diag(newey_west(columns, left, pieces, lag)) / white))
        inverse = np.linalg.inv(errors.T @ errors + noise * np.eye(errors.shape[1]))
        left = residuals - errors @ (inverse @ (errors.T @ residuals))
    return noise
