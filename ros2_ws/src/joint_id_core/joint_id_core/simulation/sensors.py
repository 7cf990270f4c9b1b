"""Sensor models: noise, finite resolution, channels that are not measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from joint_id_core.data.recording import Array, Recording
from joint_id_core.data.signals import CHANNELS
from joint_id_core.errors import JointIdError
from joint_id_core.models.transmission import GEAR_RATIO

T = TypeVar("T", float, Array)

# Channels that a UR robot reports over RTDE; motor angle and link velocity are not sent.
UR_CHANNELS = ("link_position", "motor_velocity", "current", "torque")


@dataclass(frozen=True)
class Sensors:
    """Sensors that add white noise and then round to their resolution. Channels that are not named do not change.

    Attributes:
        noise: standard deviation by channel, in the unit of the channel.
        quantum: resolution by channel, in the unit of the channel.

    Raises:
        JointIdError: unknown channel, negative or infinite noise, a resolution that is not positive.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    quantum: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _known((*self.noise, *self.quantum))
        for name, std in self.noise.items():
            if not (math.isfinite(std) and std >= 0.0):
                raise JointIdError(f"noise of {name} = {std} {CHANNELS[name].unit}: must be finite and not negative")
        for name, size in self.quantum.items():
            if not (math.isfinite(size) and size > 0.0):
                raise JointIdError(f"resolution of {name} = {size} {CHANNELS[name].unit}: must be finite and above 0")

    def reading(self, name: str, value: T, rng: np.random.Generator) -> T:
        """Return the sensor reading of a channel for one value or an array; NaN stays NaN."""
        std, size = self.noise.get(name, 0.0), self.quantum.get(name)
        shown: Any = value + std * rng.standard_normal(np.shape(value)) if std else value
        return shown if size is None else np.round(shown / size) * size

    def measure(self, recording: Recording, seed: int = 0, keep: Iterable[str] | None = None) -> Recording:
        """Return the recording as measured, with only the channels in `keep` (default: all).

        With the same seed a channel gets the same noise, independent of the other channels.

        Raises:
            JointIdError: unknown channel in `keep`.
        """
        wanted = set(recording.channels) if keep is None else set(_known(keep))
        channels = {
            name: self.reading(name, values, np.random.default_rng([seed, 1 + list(CHANNELS).index(name)]))
            for name, values in recording.channels.items()
            if name in wanted
        }
        return replace(recording, channels=channels, derived=recording.derived & frozenset(channels))


def ur_robot_sensors(N: float = GEAR_RATIO) -> Sensors:
    """Return the sensors of a Universal Robots joint with gear ratio `N`, as seen through RTDE.

    Measured on a public UR3e log (aurt, 125 Hz), noise from differences of second and fourth order:

    - link_position: the values of wrist 3 at rest are 1.2e-5 rad apart, which is 2 pi / 2^19 within the rounding of the
      stream; noise 2.0e-5 rad (five joints at rest: 1.8e-5 to 3.1e-5).
    - motor_velocity: no quantisation (single precision); noise 1.5e-3 rad/s times N on the moving shoulder. This
      includes real vibration, so it is an upper bound; at rest the controller reports zero.
    - current: no quantisation; noise 0.010 A (four joints at rest: 0.0086 to 0.013 A).

    The noise of torque is that of the current times 0.1005 Nm/A, the torque constant in the manufacturer's calibration
    of a UR5e shoulder. The robot does not send motor_position: we chose the figures of the link encoder, at the motor
    shaft.
    """
    encoder, position = 2.0 * math.pi / 2**19, 2.0e-5
    return Sensors(
        noise={
            "link_position": position,
            "motor_position": position,
            "motor_velocity": 1.5e-3 * N,
            "current": 0.010,
            "torque": 0.010 * 0.1005,
        },
        quantum={"link_position": encoder, "motor_position": encoder},
    )


def _known(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names after a check that each is a channel."""
    names = tuple(names)
    for name in names:
        if name not in CHANNELS:
            raise JointIdError(f"unknown channel {name!r}: known are {', '.join(CHANNELS)}")
    return names
