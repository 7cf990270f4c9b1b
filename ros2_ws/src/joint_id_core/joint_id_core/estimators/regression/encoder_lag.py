"""How late the encoder of the link is against that of the motor, from the twist that this makes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.covariance import automatic_lag, jackknife
from joint_id_core.estimators.regression.equations import Motion
from joint_id_core.estimators.regression.instruments import Path
from joint_id_core.estimators.regression.signals import Rows, smoothed

SURE = 4.0  # standard deviations from which a lag is one
LEAST_LAG_S = 3e-4  # a shorter one may be viscous friction of the link
ACCURACY = 0.01  # of a lag in samples: between two samples the motion is not exact
SLOW = 0.1  # of the rms velocity, over which the direction of friction changes


@dataclass(frozen=True)
class Lag:
    """By how many s the encoder of the link is late against that of the motor.

    Viscous friction of the link looks the same: it adds its ratio to the stiffness.

    Attributes:
        late, sigma: value and standard deviation in s.
        name: of the parameter that says it and that is estimated; None if there is none.
        effect: what one standard deviation more adds to the values of an equation, shape (k,).
    """

    late: float
    sigma: float
    name: str | None = None
    effect: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def sure(self) -> bool:
        """Whether it is a lag, and not noise."""
        return abs(self.late) > max(SURE * self.sigma, LEAST_LAG_S)


def encoder_lag(time: Array, moved: Motion, motor: Path, ratio: float, rows: Rows, band_hz: float) -> Lag:
    """Return what the twist says of the delay of the link's encoder: the part that goes with the velocity.

    The others are a constant, and the twist under inertia, Coulomb friction and gravity.
    """
    velocity = motor.velocity
    slow = SLOW * float(np.sqrt(np.nanmean(velocity**2))) or 1.0
    table = [
        motor.angle - moved.u["link_position"], velocity, motor.acceleration, np.tanh(velocity / slow),
        np.ones_like(velocity), np.cos(motor.angle), np.sin(motor.angle),
    ]  # fmt: skip
    rows_ = smoothed(time, np.column_stack(table), band_hz)[rows.index]
    rows_ = rows_[np.isfinite(rows_).all(axis=1)]
    scale = np.sqrt(np.mean(rows_**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    y, columns = rows_[:, 0], rows_[:, 1:] / scale[1:]

    def late(kept: NDArray[np.bool_]) -> Array:
        return np.asarray(np.linalg.lstsq(columns[kept], y[kept], rcond=None)[0][:1] / scale[1])

    whole, period = float(late(np.ones(len(y), dtype=bool))[0]), float(np.median(np.diff(time)))
    residuals = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    variance = jackknife(late, len(y), automatic_lag(columns * residuals[:, None]))[0, 0]
    return Lag(whole, float(np.hypot(np.sqrt(variance), ACCURACY * period)))
