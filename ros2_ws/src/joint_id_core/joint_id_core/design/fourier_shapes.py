"""Shapes of motions of one joint: Fourier series with soft start and end (`fourier`), as large as the limits allow.

A larger motion of the same shape tells more, so each is scaled until a limit is reached.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.fourier import FourierMotion, basis
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.search import MARGIN, Sized
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError

TONES = 6
LOWEST_PERIODS, HIGHEST_HZ = 2.0, 6.0  # tones: from so many periods in the motion up to this frequency
ABOVE = 2.0  # nor above so many times that of the sine that reaches the limits of acceleration and jerk at once
STEEPEST = 3.0  # amplitudes of random shapes fall with up to this power of the frequency
RAMP_S, RAMP_SHARE = 1.0, 0.25  # soft start and end: so long, and at most this share of the motion
TWICE = 2.0  # how much larger a motion is of which is told whether it would show more


@dataclass(frozen=True)
class Shape:
    """Frequencies in Hz, shape (tones,), and amplitudes of their cosines and sines, (2, tones), up to a scale."""

    frequencies: Array
    waves: Array


class FourierShapes:
    """Fourier series of one joint from home and back.

    Args:
        limits: of this joint alone, without infinite ones but for the torque.
        home: position at the start and end in rad.
        duration: of the motion in s.
        rate: samples a second.

    Raises:
        JointIdError: the joint is not within its limits at home.
    """

    def __init__(self, limits: JointLimits, home: float, duration: float, rate: float) -> None:
        if not limits.lower[0] < home < limits.upper[0]:
            raise JointIdError(
                f"home = {home:g} rad is not between the limits {limits.lower[0]:g} and {limits.upper[0]:g} rad"
            )
        self.limits, self.home, self.duration, self._rate = limits, home, duration, rate
        self.highest = min(HIGHEST_HZ, ABOVE * float(limits.jerk[0] / limits.acceleration[0]) / (2.0 * math.pi))
        self.ramp = min(RAMP_S, RAMP_SHARE * duration)
        self._time = np.arange(round(duration * rate) + 1) / rate

    def sized(self, shape: Shape) -> Sized | None:
        """Return a shape as large as the limits but that of the torque allow; None if nothing moves."""
        moved = self.moved(shape)
        scale, held = self._scaled(moved)
        if not math.isfinite(scale):
            return None

        def at(scale: float) -> tuple[Array, Array]:
            return self.home + scale * moved[0], scale * moved[1]

        return Sized(at, scale, held)

    def trajectory(self, shape: Shape, scale: float, name: str) -> Trajectory:
        """Return the motion, of the joint with this name."""
        cosines, sines = scale * shape.waves
        motion = FourierMotion(
            (name,), np.array([self.home]), cosines[None], sines[None], shape.frequencies, self.duration, self.ramp
        )
        return motion.sampled(self._rate)

    def told(self, shape: Shape, scale: float) -> tuple[str, ...]:
        """Return nothing: what limits the motion is said elsewhere."""
        return ()

    def beyond(self, shape: Shape, scale: float) -> tuple[Array, Array]:
        """Return position and velocity (T,) of a motion of twice the size, were there no limits."""
        position, velocity = (TWICE * scale * row for row in self.moved(shape)[:2])
        return self.home + position, velocity

    def moved(self, shape: Shape) -> Array:
        """Return position, velocity, acceleration and jerk of a shape, (4, T)."""
        return np.asarray(basis(self._time, shape.frequencies, self.duration, self.ramp) @ shape.waves.ravel())

    def random(self, rng: np.random.Generator) -> Shape:
        """Return a shape whose amplitudes fall with the frequency."""
        low = min(LOWEST_PERIODS / self.duration, 0.5 * self.highest)
        frequencies = np.exp(rng.uniform(math.log(low), math.log(self.highest), TONES))
        return Shape(frequencies, rng.standard_normal((2, TONES)) * frequencies ** -rng.uniform(0.0, STEEPEST))

    def changed(self, shape: Shape, size: float, rng: np.random.Generator) -> Shape:
        """Return a shape with some tones changed; a weak tone may become as strong, in acceleration, as others."""
        low = 1.0 / self.duration
        some = rng.random((3, TONES)) < 0.5
        frequencies = shape.frequencies * np.exp(0.5 * size * some[0] * rng.standard_normal(TONES))
        frequencies = np.clip(frequencies, low, self.highest)
        strength = np.hypot(*shape.waves)
        least = 0.1 * np.max(strength * shape.frequencies**2) / shape.frequencies**2
        waves = shape.waves + size * some[1:] * rng.standard_normal((2, TONES)) * np.maximum(strength, least)
        return Shape(frequencies, waves)

    def _scaled(self, moved: Array) -> tuple[float, str]:
        """Return the largest scale within the limits but the torque's, and which one holds it; infinite without one."""
        own, room = self.limits, {}
        up, down = float(moved[0].max()), -float(moved[0].min())
        above, below = float(own.upper[0]) - self.home, self.home - float(own.lower[0])
        room["position"] = min(above / up if up > 0.0 else math.inf, below / down if down > 0.0 else math.inf)
        for kind, values in zip(("velocity", "acceleration", "jerk"), moved[1:], strict=True):
            size = float(np.abs(values).max())
            room[kind] = float(getattr(own, kind)[0]) / size if size > 0.0 else math.inf
        held = min(room, key=lambda kind: room[kind])
        return MARGIN * room[held], held
