"""The motor's equation of motion of a joint with an encoder on both sides of the gear, for faults of its signals.

The twist of the gear, which both encoders show, drives the motor as well. So this equation holds whatever the link
carries. Its columns are inertia, friction, stiffness, cubic stiffness and damping of the gear; all are positive.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from joint_id_core.checking.signals import goes
from joint_id_core.data.recording import Array, Recording
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.estimators.regression.missing import at_speed
from joint_id_core.estimators.regression.signals import bands, motion, rows, smoothed
from joint_id_core.estimators.shared.fit_data import MIN_SAMPLES, prepare
from joint_id_core.estimators.shared.settings import ParameterSettings
from joint_id_core.filtering.offline import interpolate
from joint_id_core.models.motor_side import SMOOTHING, MotorSide

SIDES = ("motor_position", "link_position", "motor_velocity", "link_velocity")
MOST_SAMPLES = 100_000  # of a longer recording the first ones will do


@dataclass(frozen=True)
class MotorEquation:
    """The equation at the samples that are compared.

    Attributes:
        time: instants of all samples in s, shape (T,).
        moved: motion in the band of the motion, arrays (T,), NaN where it is not known.
        index: the samples that are compared, shape (R,).
        drive: torque or current in the band, shape (T,).
        own: columns of inertia and friction of the motor, shape (R, k).
        band_hz: of the equation.
    """

    time: Array
    moved: Motion
    index: NDArray[np.int64]
    drive: Array
    own: Array
    band_hz: float

    @cached_property
    def ratio(self) -> float:
        """Turns of the motor for one of the link, as the two positions show it; the twist makes it inexact."""
        motor, link = self.moved.x["motor_position"][self.index], self.moved.u["link_position"][self.index]
        return float(np.polyfit(link, motor, 1)[0])

    def twist(self, ratio: float) -> float:
        """Return the rms twist in rad, about its mean, that the positions show with a gear ratio."""
        motor, link = self.moved.x["motor_position"][self.index], self.moved.u["link_position"][self.index]
        return float(np.std(motor / ratio - link))

    def known(self, late_s: float) -> Array:
        """Return the drive (R,) as it would be if it were not late by so many s."""
        return interpolate(self.time[self.index] + late_s, self.time, self.drive)

    def columns(self, ratio: float, late_s: float = 0.0) -> Array:
        """Return all columns (R, k) for a gear ratio, and as if the link's encoder were not late by so many s."""
        x, u = self.moved.x, self.moved.u
        w, a = u["link_velocity"], u["link_acceleration"]
        twist = x["motor_position"] / ratio - u["link_position"] - late_s * (w + 0.5 * late_s * a)
        rate = x["motor_velocity"] / ratio - w - late_s * a
        gear = smoothed(self.time, np.column_stack([twist, twist**3, rate]), self.band_hz)[self.index]
        return np.column_stack([self.own, gear])


def left(y: Array, columns: Array) -> float:
    """Return the share of y (R,) about its mean that positive parts of columns (R, k) and a constant leave."""
    spread = y - y.mean()
    table = columns - columns.mean(axis=0)
    size = np.sqrt(np.mean(table**2, axis=0))
    rest = scipy.optimize.nnls(table / np.where(size > 0.0, size, 1.0), spread)[1]
    energy = float(spread @ spread)
    return float(rest**2 / energy) if energy > 0.0 else 1.0


def motor_equation(recording: Recording, drive: str, ratio: float) -> MotorEquation | None:
    """Return the equation; None unless both positions are measured and move, or with too few samples in motion.

    Args:
        recording: what was measured.
        drive: torque or current of the motor.
        ratio: of the gear; it only scales the twist.
    """
    if not all(recording.measured(n) for n in ("motor_position", "link_position", drive)):
        return None
    if not all(goes(n, recording[n]) for n in SIDES[:2]):
        return None
    channels = {n: recording[n] for n in (*SIDES, drive) if recording.measured(n)}
    part = Recording(recording.time, channels, source=recording.source).slice(0, MOST_SAMPLES)
    values: Mapping[str, float] = {"N": ratio, **({"k_t": 1.0} if drive == "current" else {})}
    model = MotorSide(actuation="current" if drive == "current" else "torque", delays=True)
    try:
        data = prepare(model, part, ParameterSettings(values), leave_out_rests=True)
        found = bands(data)
        moved = motion(data, max(found.equations, found.motion))
    except JointIdError:
        return None
    table = np.column_stack([v for group in (moved.x, moved.u, moved.rates) for v in group.values()])
    usable = np.asarray(np.isfinite(table).all(axis=1))
    chosen = rows(data, usable, found.equations).index
    chosen = chosen[at_speed(moved, chosen)]
    w, time = moved.x["motor_velocity"], data.recording.time
    signals = np.column_stack([moved.u[drive], moved.rates["motor_velocity"], w, np.tanh(w / SMOOTHING)])
    signals = smoothed(time, signals, found.equations)
    chosen = chosen[usable[chosen] & np.isfinite(signals[chosen]).all(axis=1)]
    if len(chosen) < MIN_SAMPLES:
        return None
    return MotorEquation(time, moved, chosen, signals[:, 0], signals[chosen, 1:], found.equations)
