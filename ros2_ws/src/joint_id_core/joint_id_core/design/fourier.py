"""Motions as Fourier series with a soft start and end, and their exact derivatives.

Source: J. Swevers et al., Optimal robot excitation and identification, IEEE Trans. Robotics and Automation 13, 1997; a
window is added so that a motion begins and ends at rest and without a jump of the jerk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.trajectory import State, Trajectory
from joint_id_core.errors import JointIdError

# smoothest step from 0 to 1 whose first three derivatives vanish at both ends, in powers of x from x^0 on
_STEP = np.polynomial.Polynomial([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
_ORDERS = 4  # position, velocity, acceleration, jerk


def window(time: Array, duration: float, ramp: float) -> Array:
    """Return the soft window and its first three derivatives, shape (4, n): 0 at the ends, 1 between the ramps.

    Args:
        time: instants in s, shape (n,); outside of the motion the window is 0.
        duration: of the motion in s.
        ramp: length of either ramp in s, at most half the duration.
    """
    inside = np.clip(time, 0.0, duration)
    from_start, x = inside <= duration / 2.0, np.minimum(np.minimum(inside, duration - inside) / ramp, 1.0)
    found = np.empty((_ORDERS, len(time)))
    for order in range(_ORDERS):
        sign = np.where(from_start, 1.0, (-1.0) ** order)
        found[order] = sign * _STEP.deriv(order)(x) / ramp**order if order else _STEP(x)
    return found


def basis(time: Array, frequencies: Array, duration: float, ramp: float) -> Array:
    """Return windowed cosines and sines with their first three derivatives, shape (4, n, 2 len(frequencies)).

    A motion is `home + basis @ coefficients`, the cosines of all frequencies (Hz) first; 0 Hz is a constant.
    """
    soft = window(time, duration, ramp)
    omega = 2.0 * math.pi * np.asarray(frequencies, dtype=float)
    angles = np.multiply.outer(time, omega)
    waves = np.empty((_ORDERS, len(time), 2 * len(omega)))
    for order in range(_ORDERS):
        turn = angles + order * math.pi / 2.0
        waves[order] = np.concatenate([np.cos(turn), np.sin(turn)], axis=1) * np.tile(omega**order, 2)
    found = np.zeros_like(waves)
    for order in range(_ORDERS):  # product rule
        for k in range(order + 1):
            found[order] += math.comb(order, k) * soft[k][:, None] * waves[order - k]
    return found


@dataclass(frozen=True, eq=False)
class FourierMotion:
    """A motion from `home` and back: window(t) times a sum of cosines and sines.

    Attributes:
        names: of the joints.
        home: position at the start and end in rad, shape (joints,).
        cosines, sines: coefficients in rad, shape (joints, frequencies).
        frequencies: in Hz, shape (frequencies,).
        duration: in s; ramp: length of the soft start and of the soft end in s.

    Raises:
        JointIdError: wrong shapes, values that are not finite, a ramp that is longer than half the motion.
    """

    names: tuple[str, ...]
    home: Array
    cosines: Array
    sines: Array
    frequencies: Array
    duration: float
    ramp: float

    def __post_init__(self) -> None:
        for name in ("home", "cosines", "sines", "frequencies"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        joints, tones = len(self.names), self.frequencies.size
        shapes = {"home": (joints,), "cosines": (joints, tones), "sines": (joints, tones), "frequencies": (tones,)}
        for name, shape in shapes.items():
            values: Array = getattr(self, name)
            if values.shape != shape or not np.isfinite(values).all():
                raise JointIdError(f"Fourier motion: {name} must hold finite values of shape {shape}")
        if (self.frequencies < 0.0).any():
            raise JointIdError("Fourier motion: a frequency is below 0 Hz")
        if not (math.isfinite(self.duration) and 0.0 < self.ramp <= self.duration / 2.0):
            raise JointIdError(
                f"Fourier motion of {self.duration:g} s with ramps of {self.ramp:g} s: a ramp must be above 0 and "
                "at most half the motion"
            )

    def at(self, time: Array) -> State:
        """Return the motion at instants in s, shape (n,)."""
        waves = basis(np.asarray(time, dtype=float), self.frequencies, self.duration, self.ramp)
        found = waves @ np.concatenate([self.cosines, self.sines], axis=1).T
        found[0] += self.home
        return State(*found)

    def sampled(self, rate: float) -> Trajectory:
        """Return the motion at `rate` samples a second.

        Raises:
            JointIdError: the duration is no multiple of the period, or the rate is too low for the motion.
        """
        steps = round(self.duration * rate)
        if steps < 1 or abs(steps - self.duration * rate) > 1e-6 * steps:
            raise JointIdError(f"a motion of {self.duration:g} s at {rate:g} Hz: choose a whole number of samples")
        time = np.linspace(0.0, self.duration, steps + 1)
        state = self.at(time)
        return Trajectory(self.names, time, state.position, state.velocity, state.acceleration)
