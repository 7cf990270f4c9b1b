"""What all equations of a model share in a regression: the motion, its band, and the samples that are compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.equations import Equation, Motion, columns_along
from joint_id_core.estimators.regression.estimator import Regression
from joint_id_core.estimators.regression.instruments import Tools, rigid
from joint_id_core.estimators.regression.least_squares import ACCURACY, ACCURACY_OF_CURRENT
from joint_id_core.estimators.regression.missing import at_speed, missing_torques
from joint_id_core.estimators.regression.path import Path, commanded, required
from joint_id_core.estimators.regression.presliding import turning
from joint_id_core.estimators.regression.samples import Samples
from joint_id_core.estimators.regression.signals import Rows, all_smoothed, bands, motion, rows
from joint_id_core.estimators.regression.sliding import Sliding, sliding
from joint_id_core.estimators.regression.two_sides import TwoSides, has_twist, two_sides
from joint_id_core.estimators.shared.computed_load import computed
from joint_id_core.estimators.shared.fit_data import MIN_SAMPLES, FitData, UnusableError
from joint_id_core.estimators.shared.mean_drive import slope
from joint_id_core.models import Model
from joint_id_core.results.estimate import Status

AWAY = "away "  # before the name of a table: the same without the instants at which the joint sticks


@dataclass(frozen=True)
class Prepared:
    """A recording, prepared for the equations of a model.

    Attributes:
        data: the recording.
        band_hz, cutoff_hz: of the equations, and of the motion.
        moved: the motion.
        usable: True for samples with all signals, shape (T,).
        index: the samples that are compared.
        values, free: of the parameters, and names of the free ones.
        sides: the motion on both sides of a gear; None if the model has one side.
        path: along which the instruments of one side are computed; None if least squares will do.
        missing: columns (T, m) of torques that the model lacks, by the option that adds them.
        turning: columns (T, m) of friction that turns after reversals.
    """

    data: FitData
    band_hz: float
    cutoff_hz: float
    moved: Motion
    usable: NDArray[np.bool_]
    index: Rows
    values: Mapping[str, float]
    free: tuple[str, ...]
    sides: TwoSides | None
    path: Path | None
    missing: Mapping[str, Array]
    turning: Array

    @property
    def model(self) -> Model:
        """The model."""
        return self.data.model

    @property
    def time(self) -> Array:
        """Instants of all samples in s, shape (T,)."""
        return self.data.recording.time

    def compared(self, equation: Equation) -> tuple[Samples, dict[str, Array]]:
        """Return an equation at the samples that are compared, and all tables there by name, shapes (R, m)."""
        tables = self._tables(equation)
        drive = tables.pop("drive")[:, 0]
        tables = {name: part[self.index.index] for name, part in tables.items()}
        known = np.all([np.isfinite(part).all(axis=1) for part in tables.values()], axis=0)
        tables = {name: part[known] for name, part in tables.items()}
        away = None
        if f"{AWAY}y" in tables:
            lacked = {name: tables[AWAY + name] for name in self.missing}
            away = Sliding(tables[f"{AWAY}y"], tables[f"{AWAY}columns"], tables[f"{AWAY}change"], lacked)
        index = Rows(self.index.index[known], self.index.pieces[known])
        return Samples(
            equation, index, at_speed(self.moved, index.index), tables["y"][:, 0], tables["columns"],
            {name: tables[name] for name in self.missing}, self.time, drive, self.data.period,
            self._tools(equation, tables), ACCURACY if "current" not in self.model.state_names else ACCURACY_OF_CURRENT,
            tables["turning"], tables["change"][:, 0], computed(self.data.recording), away,
        ), tables  # fmt: skip

    def _tables(self, equation: Equation) -> dict[str, Array]:
        """Return y, columns and all that may explain y, in the band, shapes (T, m) by name."""
        drive = np.zeros(len(self.usable))
        if self.model.drive:
            drive = equation.factor * self.moved.u[self.model.drive]
        change = slope(self.data.recording, self.time, drive)[:, None]
        tables = {"y": equation.y[:, None], "columns": equation.columns, "drive": drive[:, None], "change": change}
        tables |= {"turning": self.turning, **self.missing}
        if self.sides is not None:
            tables |= self.sides.beside(equation)
        elif self.path is not None:
            along = partial(columns_along, self.model, equation, values=self.values)
            tables |= {"tools": rigid(along, self.moved, self.path)}
        elif equation.state in self.model.smoothing:
            angle = self.moved.x[equation.state]
            weights = sliding(angle, self.data.period, self.cutoff_hz, self.band_hz)[:, None]
            tables |= {AWAY + name: weights * tables[name] for name in ("y", "columns", "change", *self.missing)}
        return all_smoothed(self.time, tables, self.usable, self.band_hz)

    def _tools(self, equation: Equation, tables: Mapping[str, Array]) -> Tools | None:
        """Return the instruments of an equation; None if least squares will do."""
        if self.sides is not None:
            return self.sides.tools(equation, tables["tools"])
        if self.path is not None:
            return Tools(tables["tools"], np.zeros(len(equation.names), dtype=bool))
        return None


def prepared(data: FitData, options: Regression) -> Prepared:
    """Prepare a recording for the equations of its model.

    Raises:
        JointIdError: instruments are asked for that there are not, or a band beyond half of the sampling rate.
        UnusableError: too few samples, or a state that is not measured.
    """
    found, model = bands(data), data.model
    if options.band_hz >= 0.5 / data.period:
        raise JointIdError(
            f"{data.recording.source}: band_hz = {options.band_hz:g} Hz needs more than {2.0 * options.band_hz:g} "
            f"samples/s, there are {1.0 / data.period:.4g}: give a narrower band, or leave it out"
        )
    band_hz = options.band_hz or found.equations
    cutoff_hz = max(band_hz, found.motion)
    moved = motion(data, cutoff_hz)
    usable = np.all([np.isfinite(v) for part in (moved.x, moved.u, moved.rates) for v in part.values()], axis=0)
    index = rows(data, usable, band_hz)
    if len(index.index) < MIN_SAMPLES:
        raise UnusableError(
            Status.TOO_SHORT,
            f"{data.recording.source}: {len(index.index)} independent samples of motion below {band_hz:.3g} Hz, a "
            f"regression needs {MIN_SAMPLES}: record longer, or give a wider band (band_hz)",
        )
    values: Mapping[str, float] = dict(zip(model.parameter_names, data.p.tolist(), strict=True))
    free, sides, path = data.free, None, None
    if has_twist(model):
        sides = two_sides(data, moved, index, cutoff_hz, band_hz, options.instruments)
        moved, values, free = sides.moved, sides.values, sides.free
    elif options.instruments == "command":
        path = required(commanded(data.recording, _angle_of_link(model, moved), cutoff_hz), data.recording)
    missing = missing_torques(moved, model, data.recording.time, cutoff_hz)
    turned = turning(moved, model) if sides is path is None else np.zeros((len(usable), 0))
    return Prepared(data, band_hz, cutoff_hz, moved, usable, index, values, free, sides, path, missing, turned)


def _angle_of_link(model: Model, moved: Motion) -> Array:
    """Return the angle of the link, shape (T,).

    Raises:
        JointIdError: it is no state of the model.
    """
    if "link_position" not in moved.x:
        raise JointIdError(
            f"instruments = command: model {model.name} has no link_position, which a command is compared with; leave "
            "this option out"
        )
    return moved.x["link_position"]
