"""Joints with an encoder on both sides of the gear: the lag between these, instruments, and what their errors do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.data.signals import side_of
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.encoder_lag import Lag, encoder_lag
from joint_id_core.estimators.regression.equations import Equation, Motion, columns_along, equations
from joint_id_core.estimators.regression.instruments import Tools, bent, beyond, instruments
from joint_id_core.estimators.regression.least_squares import Solution, two_stage
from joint_id_core.estimators.regression.path import Path, commanded, of_motor, required
from joint_id_core.estimators.regression.signals import Rows
from joint_id_core.estimators.shared.fit_data import FitData
from joint_id_core.models import Model


def has_twist(model: Model) -> bool:
    """Return whether a model has motion on both sides of the gear."""
    return {side_of(n) for n in (*model.state_names, *model.input_names)} >= {"motor", "link"}


@dataclass(frozen=True)
class TwoSides:
    """The motion on both sides of a gear.

    Attributes:
        moved: with the link's encoder corrected by `lag`, if the model has a delay that is estimated.
        later: the same corrected by a standard deviation more.
        path: along which the instruments are computed.
        ratio: of the gear.
        lag: what the twist says of the delay, and whether it was corrected.
        values, free: those of the parameters, without the delays and what no instruments can show.
    """

    model: Model
    moved: Motion
    later: Motion
    path: Path
    ratio: float
    lag: Lag
    values: Mapping[str, float]
    free: tuple[str, ...]

    def beside(self, equation: Equation) -> dict[str, Array]:
        """Return what a fit of an equation needs beside its columns, arrays (T, m) by name.

        These are the instruments, the columns with a later encoder, and the angle, with which errors of encoders go.
        """
        along = partial(columns_along, self.model, equation, values=self.values)
        return {
            "tools": instruments(along, self.moved, self.path, self.ratio),
            "later": along(self.later),
            "angle": self.path.angle[:, None],
        }

    def tools(self, equation: Equation, table: Array) -> Tools:
        """Return the instruments of an equation, whose signals are the `table` (R, m)."""
        along = partial(columns_along, self.model, equation, values=self.values)
        return Tools(table, bent(along, self.moved, self.ratio))

    def with_lag_in_doubt(
        self, names: Sequence[str], y: Array, tables: Mapping[str, Array], solution: Solution
    ) -> tuple[Solution, Lag]:
        """Return the solution of y (T,) for the parameters `names`, in doubt of the encoders, and the lag of these.

        Its covariance contains what errors of the encoders may do. These are the uncertainty of the lag, and errors
        that go with the angle, as those of an eccentric disc or of a slightly wrong gear ratio: what a column for them
        changes counts as uncertain, and what a bound changes as well. `tables` are the columns (T, k) and those of
        `beside`.
        """

        def values(columns: Array, tools: Array) -> Array:
            usable = ~solution.unseen
            found = np.full(len(usable), np.nan)
            extra = columns.shape[1] - len(usable)
            kept = np.concatenate([usable, np.ones(extra, dtype=bool)])
            found[usable] = two_stage(y, columns[:, kept], tools)[: np.count_nonzero(usable)]
            return found

        columns, tools, angle = tables["columns"], tables["tools"], tables["angle"]
        step = values(tables["later"], tools) - solution.unbounded
        lag = self._lag(names, solution.unbounded, step)
        turned = values(np.column_stack([columns, angle]), np.column_stack([tools, angle])) - solution.unbounded
        bound = solution.values - solution.unbounded  # what the data say beside what is possible
        covariance = solution.covariance
        for apart in (turned, lag.effect, bound):
            covariance = covariance + np.outer(apart, apart)
        wider = replace(solution, covariance=covariance, sigma=np.sqrt(np.diag(covariance)))
        return wider, lag

    def _lag(self, names: Sequence[str], values: Array, step: Array) -> Lag:
        """Return the lag with its effect on values (k,), which one standard deviation of it changes by `step`.

        The part of it that may be viscous friction of the link counts as uncertain: with all of the friction at the
        link, that at the motor would be zero.
        """
        lag = self.lag
        if lag.name is None:
            return replace(lag, effect=np.zeros_like(step))
        slope, positive = step / lag.sigma, np.array([self.model.parameter(n).positive for n in names])
        grows = positive & (slope > 0.0) & (values > 0.0)
        most = float(np.min(values[grows] / slope[grows], initial=np.inf))
        sigma = float(np.hypot(lag.sigma, 0.5 * most)) if np.isfinite(most) else lag.sigma
        return replace(lag, sigma=sigma, effect=sigma * slope)


def two_sides(
    data: FitData, moved: Motion, rows: Rows, cutoff_hz: float, band_hz: float, choice: str
) -> TwoSides:  # fmt: skip
    """Return the motion on both sides of the gear of a model that has both; signals had a low-pass with this cutoff.

    `choice` is of the instruments, as in the options.

    Raises:
        JointIdError: the encoders are held at a delay against the drive, or the chosen command is missing.
    """
    model, time = data.model, data.recording.time
    values = dict(zip(model.parameter_names, data.p.tolist(), strict=True))
    if values.get(model.drive_lag or "", 0.0) != 0.0 and model.drive_lag not in data.free:
        raise JointIdError(
            f"estimator regression does not shift the drive by {model.drive_lag}: correct the times of the recording, "
            f"or leave {model.drive_lag} at 0"
        )
    ratio, own = model.gear_ratio(values), model.encoder_lag
    motor = of_motor(moved, ratio)
    command = None if choice == "motion" else commanded(data.recording, motor.angle, cutoff_hz)
    path = required(command, data.recording) if choice == "command" else command or motor
    lag = encoder_lag(time, moved, motor, ratio, rows, band_hz)
    if own is None or own not in data.free:
        late, step = values.get(own or "", 0.0), 0.0
    else:
        late, step, lag = lag.late, lag.sigma, replace(lag, name=own)
    delays = {n for n in (own, model.drive_lag) if n is not None}
    values = {n: 0.0 if n in delays else v for n, v in values.items()}
    moved, later = _corrected(moved, late), _corrected(moved, late + step)
    free = tuple(n for n in data.free if n not in delays)
    for equation in equations(model, moved, values, free):
        hidden = beyond(partial(columns_along, model, equation, values=values), moved, ratio)
        free = tuple(n for n in free if n not in np.array(equation.names)[hidden])
    return TwoSides(model, moved, later, path, ratio, lag, values, free)


def _corrected(moved: Motion, late: float) -> Motion:
    """Return the motion with the link's encoder as it were if it were not late by so many s."""
    u = dict(moved.u)
    w = u["link_velocity"]
    a = u["link_acceleration"] if "link_acceleration" in u else np.zeros_like(w)
    u["link_position"], u["link_velocity"] = u["link_position"] + late * (w + 0.5 * late * a), w + late * a
    return replace(moved, u=u)
