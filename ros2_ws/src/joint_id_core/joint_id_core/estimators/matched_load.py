"""A computed load that is matched to the motion, as far as the bodies of its description may be off.

A load that is wrong by a part of a percent of its masses is taken for friction and inertia, and one that is wrong by
some percent leaves a poor fit. So what it may be off by (`arm.load_errors`) is fitted to the recording beside the
parameters, with the widths of its prior. Least squares with more columns give, for the parameters, what they give
without them for the load that was found, and a covariance that is larger by what is not known of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.load_errors import LoadErrors
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.load_size import size_deviation
from joint_id_core.estimators.shared.computed_load import LOAD
from joint_id_core.estimators.shared.held_values import CONSTANT
from joint_id_core.estimators.shared.intervals import with_covariance
from joint_id_core.estimators.shared.long_record import fitted_part
from joint_id_core.estimators.shared.sentences import sentence
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.models import Model
from joint_id_core.results.estimate import Estimate

if TYPE_CHECKING:  # SciPy loads with it
    from joint_id_core.estimators.regression.prepared import Prepared

LEAST = 0.5  # share of the samples at which errors of the load must be known
ROUNDS = 5  # in which the noise is found, and how wide a prior must be
# Parameters of a flexible joint that take what is wrong with the load on its link, by those of a rigid one.
OF_LINK = {"J": "J_q", "c": "c_q", "tau_f": "tau_fq", "tau_0": ""}
TOLD = 0.1  # rms of what was added to the load, over that of the load or of the other torque, from which it is told
FAR = 1.0  # rms of the factors from which more is wrong than masses


@dataclass(frozen=True)
class _Seen:
    """What one recording says of the factors of the errors, beside parameters of its own.

    Attributes:
        names: of the k parameters.
        moves: what one unit of each error changes of them, shape (k, m).
        least: their least standard deviations, shape (k,), as the equations are not exact: see `least_squares`.
        information, vector: on the factors, shapes (m, m) and (m,).
        torque: rms of the torque that the parameters explain.
    """

    names: tuple[str, ...]
    moves: Array
    least: Array
    information: Array
    vector: Array
    torque: float


class MatchedLoad:
    """The load that suits the motion of recordings of one joint.

    It is found by inverse dynamics, of a flexible joint by those of a rigid one. If nothing is told of its errors, or
    these do not suit the recordings, it is the computed one. A rigid joint lacks what a flexible one does, and the load
    takes up some of it: so that is for a computed load that leaves a poor fit (`second_choice`).

    Args:
        model, settings: as of `estimators.fit`.
        recordings: of the joint.

    Attributes:
        second_choice: whether it is another one than the computed load, which is to be tried first.

    Raises:
        JointIdError: the loads are by different descriptions.
    """

    def __init__(self, model: Model, recordings: Sequence[Recording], settings: ParameterSettings | None) -> None:
        from joint_id_core.estimators.regression.fit import suits  # loads SciPy

        self._model = model
        _require_one([one.load_errors.of for one in recordings if one.load_errors is not None])
        self._seen = [_seen(model, recording, settings) for recording in recordings]
        known = [seen for seen in self._seen if seen is not None]
        self._factors: Array | None = None
        self._width = 1.0
        if known:
            information = np.sum([one.information for one in known], axis=0)
            vector = np.sum([one.vector for one in known], axis=0)
            self._factors, self._covariance, self._width = _solved(information, vector)
        self.second_choice = self._factors is not None and not suits(model)
        self._said = self._told(recordings)

    def of(self, recording: Recording) -> Recording:
        """Return a recording with this load; it may be another one of the joint."""
        errors, bare = recording.load_errors, recording.with_load_errors(None)
        if errors is None or self._factors is None:
            return bare
        middle = recording.time + 0.5 * recording.period  # a load is held over the step after each sample
        return bare.with_channels({LOAD: recording[LOAD] + errors.at(middle) @ self._factors}, derived=True)

    def with_doubt(self, estimate: Estimate, number: int | None = None) -> Estimate:
        """Return an estimate of the recording with this number, or of all, with what is not known of the load."""
        used = [one for one in (self._seen if number is None else self._seen[number : number + 1]) if one is not None]
        if not used or not estimate.free or estimate.status.unusable:
            return estimate
        names = [name for name in used[0].names if name in estimate.free]
        own, here = [used[0].names.index(n) for n in names], [estimate.free.index(n) for n in names]
        moves, least = (np.mean([getattr(one, what) for one in used], axis=0)[own] for what in ("moves", "least"))
        covariance = estimate.covariance.copy()
        covariance[np.ix_(here, here)] += moves @ self._covariance @ moves.T + np.diag(least**2)
        estimate = with_covariance(self._model, estimate, covariance)
        if not self._said:
            return estimate
        notes = (*estimate.notes[:1], sentence(self._said), *estimate.notes[1:])
        return estimate.noted(notes)

    def size_deviation(self, recordings: Sequence[Recording], matched: bool) -> float:
        """Return how far the size of the load is not known, matched or as computed: see `load_size`."""
        return size_deviation(recordings, self._factors if matched else None, self._width)

    def _told(self, recordings: Sequence[Recording]) -> str:
        """Return how far the load is from the computed one, as a clause; "" if it is near."""
        used = [(one, seen) for one, seen in zip(recordings, self._seen, strict=True) if seen is not None]
        if self._factors is None:
            return ""
        load = _rms(np.concatenate([one[LOAD] for one, _ in used]))
        added = _rms(np.concatenate([self.of(one)[LOAD] - one[LOAD] for one, _ in used]))
        if added < TOLD * max(load, *(seen.torque for _, seen in used)) and not self.second_choice:
            return ""
        why = "masses of the description or the torque constant are off"
        if _rms(self._factors) > FAR:
            why = "more than masses of the description is off, perhaps a tool is missing"
        return (
            f"the load was matched to the motion: {added:.3g} Nm rms were added to {load:.3g} Nm, as {why} "
            "(joint-id arm fit --out writes a description that suits)"
        )


def _rms(values: Array) -> float:
    """Return the root of the mean square of the known values."""
    return float(np.sqrt(np.nanmean(values**2)))


def _solved(information: Array, vector: Array) -> tuple[Array, Array, float]:
    """Return the factors (m,), their covariance (m, m) and the width of their prior, from what the recordings say.

    Their prior is as wide as the factors that the recordings tell (MacKay, Neural Computation 4, 1992), with one more
    of size 1: a description whose masses are right is known to be so.
    """
    count, width = len(vector), 1.0
    for _ in range(ROUNDS):
        covariance = np.asarray(np.linalg.inv(information + np.eye(count) / width**2), dtype=float)
        factors = covariance @ vector
        known = count - float(np.trace(covariance)) / width**2  # factors that the recordings tell
        width = float(np.sqrt((factors @ factors + 1.0) / (known + 1.0)))
    return factors, covariance, width


def _require_one(loads: Sequence[str]) -> None:
    if len(set(loads)) > 1:
        raise JointIdError(f"{' and '.join(dict.fromkeys(loads))}: fit recordings with one description of one joint")


def _seen(model: Model, recording: Recording, settings: ParameterSettings | None) -> _Seen | None:
    """Return what a recording says of the errors of its load; None if it says nothing."""
    errors = recording.load_errors
    if errors is None or model.load != LOAD or LOAD not in recording:
        return None
    from joint_id_core.estimators.regression.as_rigid import as_rigid  # loads SciPy, as the next
    from joint_id_core.estimators.regression.estimator import Regression
    from joint_id_core.estimators.regression.fit import suits
    from joint_id_core.estimators.regression.prepared import prepared
    from joint_id_core.estimators.shared.fit_data import prepare

    settings, part, names = _torque_known(settings), fitted_part(model, recording), dict[str, str]()
    if not suits(model):
        p, _ = (settings or ParameterSettings()).applied_to(model)
        rigid = as_rigid(part, dict(zip(model.parameter_names, p.tolist(), strict=True)), gravity=False)
        if rigid is None or rigid.side != "link":
            return None
        if not model.has_torque_offset:  # else a load that is off by a constant would be as good
            held = {**rigid.settings.values, "tau_0": 0.0}
            rigid = rigid._replace(settings=replace(rigid.settings, values=held, fixed=["tau_0"]))
        model, part, settings, names = rigid.model, rigid.recording, rigid.settings, OF_LINK
    try:
        ready = prepared(prepare(model, part, settings, leave_out_rests=True), Regression())
    except JointIdError:
        return None
    return _seen_by(ready, errors, names)


def _torque_known(settings: ParameterSettings | None) -> ParameterSettings | None:
    """Return settings that hold the torque constant: else no torque and no load at all would suit any motion."""
    if settings is None or CONSTANT not in settings.freed:
        return settings
    freed = [name for name in settings.freed if name != CONSTANT]
    priors = {name: prior for name, prior in settings.priors.items() if name != CONSTANT}
    return replace(settings, freed=freed, priors=priors)


def _seen_by(ready: Prepared, errors: LoadErrors, names: Mapping[str, str]) -> _Seen | None:
    """Return the same from the equation of motion; `names` are those of its parameters in the model, if others."""
    from joint_id_core.estimators.regression.equations import equations  # loads SciPy, as the next
    from joint_id_core.estimators.regression.signals import all_smoothed

    found = next((e for e in equations(ready.model, ready.moved, ready.values, ready.free) if e.factor), None)
    if found is None:
        return None
    samples, _ = ready.compared(found)
    torques = errors.at(ready.time)
    usable = ready.usable & np.isfinite(torques).all(axis=1)
    table = all_smoothed(ready.time, {LOAD: torques}, usable, ready.band_hz)[LOAD][samples.rows.index]
    known = np.flatnonzero(np.isfinite(table).all(axis=1))
    if len(known) < LEAST * len(table):
        return None
    y, table, columns = samples.y[known], table[known], samples.columns[known]
    seen = np.any(columns != 0.0, axis=0)
    if not seen.any():
        return None
    columns = columns[:, seen]
    moves, least = np.zeros((len(found.names), table.shape[1])), np.zeros(len(found.names))
    moves[seen] = np.linalg.lstsq(columns, table, rcond=None)[0]
    least[seen] = samples.accuracy * _rms(y) / np.sqrt(np.mean(columns**2, axis=0))
    beside = table - columns @ moves[seen]
    noise = max(_noise(y, columns, beside, samples.rows.pieces[known]), (samples.accuracy * _rms(y)) ** 2)
    own = tuple(names.get(n, n) for n in found.names)
    return _Seen(own, moves, least, beside.T @ beside / noise, beside.T @ y / noise, _rms(y))


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
