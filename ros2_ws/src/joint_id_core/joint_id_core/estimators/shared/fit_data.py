"""Check a recording against a model and convert both to the arrays that an estimator works on."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array, Recording, any_finite
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.shared.computed_load import LOAD, computed
from joint_id_core.estimators.shared.derived_inputs import with_inputs
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.estimators.shared.stillness import held_still, still_in_record, still_link, wound_up
from joint_id_core.models import Model
from joint_id_core.models.curved_inputs import curved
from joint_id_core.results.estimate import Estimate, ParameterEstimate, Predictions, Status, Verdict

# Longest gap, in samples, over which the state is predicted. The input is unknown in a gap. After a longer one (a lost
# connection) the state starts again from its prior, with the same parameters.
LONGEST_GAP = 5
# After a rest or a long gap labels tell the state, and nothing of the parameters: until then the state is that of the
# prior, but a controller has seen the joint before, so the inputs depend on the errors of this prior.
SETTLE_S = 0.05
MIN_SAMPLES = 50  # fewer samples do not determine several parameters and their covariance


class UnusableError(JointIdError):
    """The data cannot be fitted; `status` says why. Estimators turn it into an `Estimate`."""

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True)
class FitData:
    """Arrays of one estimation.

    Attributes:
        model: the model to fit.
        time: instants in s, shape (T,).
        u: inputs, shape (T, inputs), without NaN; velocities as `curved` gives them.
        y: labels, shape (T, labels), NaN where missing.
        labels: their channel names; label_states (labels,): their index among the states.
        p: start values of all parameters in the model's order.
        free: names of the parameters to estimate.
        priors: prior standard deviations by parameter, as in `ParameterSettings`.
        period: typical time step in s: the mean step, or the median step if there are gaps.
        gap: number of missing samples between each sample and the next one, shape (T,).
        rest: True for samples at rest, which have no labels, shape (T,).
        dropped: number of samples left out because an input was missing.
        recording: the recording with derived channels.
    """

    model: Model
    time: Array
    u: Array
    y: Array
    labels: tuple[str, ...]
    label_states: np.ndarray
    p: Array
    free: tuple[str, ...]
    priors: Mapping[str, float]
    period: float
    gap: Array
    rest: NDArray[np.bool_]
    dropped: int
    recording: Recording

    @property
    def freed(self) -> tuple[str, ...]:
        """Names of the estimated parameters that are fixed in the model's table."""
        held = {p.name for p in self.model.parameters if p.fixed}
        return tuple(name for name in self.free if name in held)

    @property
    def noise_names(self) -> tuple[str, ...]:
        """Names of the noise levels of a fit: labels, then inputs."""
        return (*self.labels, *(f"input {name}" for name in self.model.input_names))

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """True where a label was measured, shape (T, labels)."""
        return np.isfinite(self.y)

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """Samples at which the state starts again: where motion begins after a rest, and after a long gap."""
        return np.flatnonzero((self.rest[:-1] & ~self.rest[1:]) | (self.gap[:-1] > LONGEST_GAP)) + 1

    @cached_property
    def settling(self) -> NDArray[np.int64]:
        """Samples less than `SETTLE_S` after `starts`."""
        ends = np.searchsorted(self.time, self.time[self.starts] + SETTLE_S)
        rows = [np.arange(begin, end) for begin, end in zip(self.starts, ends, strict=True)]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *rows]))

    @cached_property
    def table(self) -> Array | None:
        """The labels as rows, shape (labels, T); None if any value is missing."""
        return np.ascontiguousarray(self.y.T) if self.present.all() else None

    @cached_property
    def rows(self) -> tuple[Array, ...]:
        """The measured values of each label, without NaN, as contiguous arrays."""
        if self.table is not None:
            return tuple(self.table)
        return tuple(np.ascontiguousarray(y[seen]) for y, seen in zip(self.y.T, self.present.T, strict=True))

    @cached_property
    def span(self) -> Array:
        """Largest minus smallest value of each label, shape (labels,); NaN for a label without values."""
        if self.table is not None:
            return np.asarray(self.table.max(axis=1) - self.table.min(axis=1))
        return np.array([float(row.max() - row.min()) if len(row) else math.nan for row in self.rows])

    def predictions(self, predicted: Mapping[str, Array], horizon_s: float) -> Predictions:
        """Return the predicted labels, by name, together with the measured ones and the inputs."""
        measured = {name: self.y[:, k] for k, name in enumerate(self.labels)}
        return Predictions(self.time, measured, predicted, self.inputs, horizon_s)

    @property
    def inputs(self) -> dict[str, Array]:
        """Inputs that act, by name, shape (T,): not those that are zero throughout."""
        return {name: u for name, u in zip(self.model.input_names, self.u.T, strict=True) if np.any(u)}

    def part(self, first: int, last: int) -> FitData:
        """Return the data of the samples from `first` to before `last`."""
        rows = {name: getattr(self, name)[first:last] for name in ("time", "u", "y", "gap", "rest")}
        return replace(self, **rows)


def prepare(
    model: Model, recording: Recording, settings: ParameterSettings | None = None, leave_out_rests: bool = False
) -> FitData:
    """Check a recording against a model and build the arrays of the fit.

    Samples that lack an input are dropped, and the time step before them becomes longer. Labels are measured states.

    With `leave_out_rests` samples at rest have no labels.

    Raises:
        UnusableError: too short, no motion, or a signal is missing.
        JointIdError: misuse of parameter names or values.
    """
    settings = settings or ParameterSettings()
    p, free = settings.applied_to(model)
    if len(recording) < MIN_SAMPLES:
        raise UnusableError(
            Status.TOO_SHORT,
            f"{recording.source} has {len(recording)} samples in this window, a fit needs {MIN_SAMPLES}: "
            "record longer or widen the window",
        )
    recording = with_inputs(model, recording)
    columns = []
    for name in model.input_names:
        if name in recording and any_finite(recording[name]):
            columns.append(recording[name])
        elif name == LOAD and computed(recording):
            raise UnusableError(
                Status.MISSING_SIGNAL,
                f"{recording.source}: the load of the rest of the arm is not known: the diagnostics of the filter say "
                "what is missing",
            )
        elif name in model.optional_inputs:
            columns.append(np.zeros(len(recording)))
        else:
            raise UnusableError(
                Status.MISSING_SIGNAL,
                f"{recording.source} has no {name}, an input of model {model.name}: it has "
                f"{', '.join(n for n in recording.channels if recording.measured(n)) or 'nothing'}"
                f"{f', and an empty {name}' if name in recording else ''}; record it, rename a column to it (--map), "
                "or use another model",
            )
    u = np.array(columns).T.copy()
    usable = np.isfinite(u)
    labels = tuple(n for n in model.state_names if recording.measured(n))
    if not labels:
        raise UnusableError(
            Status.MISSING_SIGNAL,
            f"{recording.source} measures none of the states of model {model.name} "
            f"({', '.join(model.state_names)}): record at least one, or rename a column to it (--map)",
        )
    y, time = without_frozen(np.array([recording[n] for n in labels])).T.copy(), np.ascontiguousarray(recording.time)
    if not usable.all():
        rows = usable.all(axis=1)
        u, y, time = u[rows], y[rows], time[rows]
    steps = time[1:] - time[:-1]
    period, gap = (float(time[-1] - time[0]) / len(steps) if len(steps) else 1.0), np.zeros(len(time))
    if len(steps) and steps.max() > 1.25 * period:  # there are gaps, or jitter of that size
        period = float(np.median(steps))
        np.maximum(np.rint(steps / period) - 1.0, 0.0, out=gap[:-1])
    present = np.isfinite(y)
    seen = len(y) if present.all() else int(np.count_nonzero(present.any(axis=1)))
    if seen < MIN_SAMPLES:
        raise UnusableError(
            Status.TOO_SHORT,
            f"{recording.source}: only {len(time)} samples have all inputs ({', '.join(model.input_names)}) and only "
            f"{seen} of these a label ({', '.join(labels)}), a fit needs {MIN_SAMPLES}: look for missing values with "
            "`joint-id info`",
        )
    at_rest = _at_rest(recording, labels, y, period) if leave_out_rests else np.zeros(len(y), dtype=bool)
    y[at_rest] = np.nan
    if at_rest.any() and len(time) - np.count_nonzero(at_rest) < MIN_SAMPLES:
        raise UnusableError(Status.NO_MOTION, _resting(recording, labels))
    index = np.array([model.state_names.index(n) for n in labels], dtype=np.int64)
    dropped = len(recording) - len(time)
    u = curved(model, time, u)
    data = FitData(model, time, u, y, labels, index, p, free, settings.priors, period, gap, at_rest, dropped, recording)
    if not (data.span > 0.0).any():
        raise UnusableError(Status.NO_MOTION, _resting(recording, labels))
    return data


def _at_rest(recording: Recording, labels: tuple[str, ...], y: Array, period: float) -> NDArray[np.bool_]:
    """Return True for samples that tell nothing because the joint or its link rests, shape (T,)."""
    rest = still_in_record(labels, y, period)
    if not rest.any() or rest.all():
        return rest
    if held_still(recording):
        return np.zeros_like(rest)
    return wound_up(rest, still_link(labels, y, period), period)[0]


def _resting(recording: Recording, labels: tuple[str, ...]) -> str:
    what = f"{recording.source}: {', '.join(labels)} did not change in this window"
    return f"{what}: move the joint, or check the sensor"


def without_frozen(rows: Array) -> Array:
    """Return the signals (signals, T) with NaN for repeated zeros of a sensor that has a much finer resolution.

    Robots report a velocity of exactly zero below a threshold. These zeros are not measurements: used as labels, they
    would drive the estimated noise of the sensor to zero. Signals of a quantised sensor are not changed.
    """
    repeats = rows[:, 1:] == rows[:, :-1]
    if not repeats.any():
        return rows
    for k in np.flatnonzero(np.count_nonzero(repeats, axis=1) >= 0.02 * rows.shape[1]):
        row = rows[k]
        steps = np.abs(row[1:] - row[:-1])
        moving = steps[steps > 0.0]
        if moving.size and float(np.min(moving)) <= 1e-3 * float(np.median(moving)):
            row[1:][(steps == 0.0) & (row[1:] == 0.0)] = np.nan
    return rows


def options_of(model: Model) -> dict[str, Any]:
    """Return the options that a model was built with, by name."""
    return {f.name: getattr(model, f.name) for f in fields(model)}


def origin_of(recording: Recording) -> dict[str, Any]:
    """Return the fields of an `Estimate` that say where its data came from, and how warm the joint was."""
    return {
        "origin": recording.origin, "source": recording.source, "joint": recording.joint,
        "temperature": recording.mean("temperature"),
    }  # fmt: skip


def unusable(
    model: Model, estimator: str, error: UnusableError, recording: Recording, settings: ParameterSettings | None = None
) -> Estimate:
    """Return the estimate for data that cannot be fitted: start values, NaN deviations, the reason in `message`."""
    given = settings or ParameterSettings()
    held = {q.name for q in model.parameters if q.fixed and q.name not in given.freed} | {*given.fixed}
    rows = tuple(
        ParameterEstimate(
            q.name, q.unit, given.values.get(q.name, q.nominal), float("nan"),
            Verdict.FIXED if q.name in held else Verdict.NOT_EXCITED,
        )
        for q in model.parameters
    )  # fmt: skip
    span = (float(recording.time[0]), float(recording.time[-1])) if len(recording) else (float("nan"), float("nan"))
    text = str(error).rstrip(".") + "."  # a sentence, as every message
    return Estimate(
        model.name, estimator, error.status, text, rows, start=span[0], end=span[1], samples=len(recording),
        model_options=options_of(model), notes=(text,), **origin_of(recording),
    )  # fmt: skip
