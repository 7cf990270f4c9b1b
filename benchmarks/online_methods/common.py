"""What the methods share: the signals of Model 2, what is known of them, and how a method is called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from online.joints import K_T, SENSORS
from peers.model2 import FREE, MODEL

from joint_id_core.data.recording import Array
from joint_id_core.models.transmission import GEAR_RATIO as N

PERIOD_S, MEMORY_S = 2e-3, 60.0
KEPT = float(np.exp(-PERIOD_S / MEMORY_S))  # of what is known, from sample to sample
SIGMA_Q, SIGMA_W = SENSORS.noise["link_position"], SENSORS.noise["motor_velocity"]
START = np.log([MODEL.values()[name] for name in FREE])
SPREAD = 0.15  # of the logarithms at the start: no joint is farther from the nominal one


@dataclass(frozen=True)
class Signals:
    """A record: link position in rad, motor velocity in rad/s and motor torque in Nm, shape (T,) each."""

    q: Array
    w: Array
    torque: Array

    def part(self, begin: int, end: int) -> Signals:
        """Samples from `begin` up to `end`."""
        return Signals(self.q[begin:end], self.w[begin:end], self.torque[begin:end])


@dataclass(frozen=True)
class Known:
    """Values and standard deviations of the nine parameters, by name, SI units; NaN where a method gives none."""

    values: Mapping[str, float]
    sigmas: Mapping[str, float]


class Method(Protocol):
    """A method that takes samples as they come."""

    def update(self, samples: Signals) -> None:
        """Take new samples."""

    def known(self) -> Known:
        """What is known now."""


def signals(channels: Mapping[str, Array]) -> Signals:
    """Signals of a recording whose current is known to drive with `K_T`."""
    return Signals(channels["link_position"], channels["motor_velocity"], K_T * channels["current"])


def of_logarithms(z: Array, covariance: Array) -> Known:
    """Known values from logarithms (9,) and their covariance (9, 9)."""
    values = np.exp(z)
    sigmas = values * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Known(dict(zip(FREE, values.tolist(), strict=True)), dict(zip(FREE, sigmas.tolist(), strict=True)))


def first_state(q: float) -> tuple[Array, Array]:
    """State at the start and its covariance: at rest, the gear twisted by at most some hundredths of a radian."""
    return np.array([N * q, q, 0.0, 0.0]), np.diag([(0.02 * N) ** 2, SIGMA_Q**2, 10.0**2, 0.1**2])
