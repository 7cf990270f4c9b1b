"""Input and reference signals that excite the parameters of a joint: steps and multisines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError

# Default voltages: steps of both signs and two sizes, so that viscous and Coulomb friction can be separated. None is
# zero: a joint at rest sticks exactly, and the smoothed friction of the estimators describes that only approximately.
STEPS_V = (12.0, -12.0, 6.0, -6.0)
STEP_S = 0.5

Phases = Literal["schroeder", "random"]


def step(time: ArrayLike, amplitude: float, start: float = 0.0) -> Array:
    """Return a step: `amplitude` from `start` in s on, zero before; shape of `time`."""
    return np.where(np.asarray(time, dtype=float) >= start, float(amplitude), 0.0)


@dataclass(frozen=True)
class Multisine:
    """A sum of cosines: sum of a_k cos(2 pi f_k t + phi_k).

    Attributes:
        amplitudes: a_k, in the unit of the signal.
        frequencies: f_k in Hz.
        phases: phi_k in rad.
    """

    amplitudes: tuple[float, ...]
    frequencies: tuple[float, ...]
    phases: tuple[float, ...]

    def value(self, time: ArrayLike) -> Array:
        """Return the signal at `time` in s, shape of `time`."""
        return np.cos(self._angles(time)) @ np.array(self.amplitudes)

    def rate(self, time: ArrayLike) -> Array:
        """Return the time derivative of the signal at `time` in s, shape of `time`."""
        return -np.sin(self._angles(time)) @ (np.array(self.amplitudes) * 2.0 * math.pi * np.array(self.frequencies))

    def _angles(self, time: ArrayLike) -> Array:
        omega = 2.0 * math.pi * np.array(self.frequencies)
        return np.multiply.outer(np.asarray(time, dtype=float), omega) + np.array(self.phases)


def harmonics(low: float, high: float, period: float) -> tuple[float, ...]:
    """Return the multiples of 1/`period` (s) from `low` to `high` (Hz), both included: tones without leakage.

    Raises:
        JointIdError: no multiple lies in the band.
    """
    if not (period > 0.0 and 0.0 < low <= high):
        raise JointIdError(f"band {low} to {high} Hz with period {period} s: need 0 < low <= high and a period above 0")
    first, last = math.ceil(low * period - 1e-9), math.floor(high * period + 1e-9)
    if first > last:
        raise JointIdError(f"no multiple of 1/{period:g} Hz lies in {low:g} to {high:g} Hz: lengthen the period")
    return tuple(k / period for k in range(first, last + 1))


def build_multisine(
    amplitude: float,
    frequencies: Sequence[float],
    seed: int | None = None,
    roll_off: float = 0.0,
) -> Multisine:
    """Build a multisine whose peak over 10 periods of its lowest tone is `amplitude`.

    Amplitudes fall as f^-roll_off: 0 gives a flat spectrum, 2 for a position gives a flat spectrum of its acceleration.
    Phases are random with a `seed`, else Schroeder's (1970), which keep the peak low.

    Raises:
        JointIdError: no frequency, one that is not positive or occurs twice, an amplitude that is not finite.
    """
    f = np.asarray(frequencies, dtype=float)
    if f.ndim != 1 or not f.size or not np.all(np.isfinite(f) & (f > 0.0)) or len(np.unique(f)) < f.size:
        raise JointIdError(
            f"multisine frequencies {list(frequencies)} Hz: need one or more, positive and all different"
        )
    if not math.isfinite(amplitude):
        raise JointIdError(f"multisine amplitude = {amplitude}: must be finite")
    a = (f / f[0]) ** -roll_off
    if seed is None:
        # phi_k = -2 pi sum_{j<k} (k - j) p_j with the relative powers p_j
        power = a**2 / np.sum(a**2)
        phases = -2.0 * math.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(power))[:-1]])
    else:
        phases = np.random.default_rng(seed).uniform(-math.pi, math.pi, f.size)
    raw = Multisine(tuple(a.tolist()), tuple(f.tolist()), tuple(phases.tolist()))
    grid = np.arange(0.0, 10.0 / f.min(), 0.02 / f.max())
    peak = float(np.max(np.abs(raw.value(grid))))
    return Multisine(tuple((a * amplitude / peak).tolist()), raw.frequencies, raw.phases)


def multisine(time: ArrayLike, amplitude: float, frequencies: Sequence[float], seed: int | None = None) -> Array:
    """Return a multisine with a flat spectrum and peak `amplitude` at `time` in s; see `build_multisine`."""
    return build_multisine(amplitude, frequencies, seed).value(time)


def position_reference(
    amplitude: float = 0.4, low: float = 0.5, high: float = 10.0, period: float = 2.0, seed: int | None = 1
) -> Multisine:
    """Build a reference of the link position: peak `amplitude` in rad, tones from `low` to `high` in Hz, `period` in s.

    Amplitudes fall as 1/f^2, so that every tone needs the same acceleration and thus the same torque.
    """
    return build_multisine(amplitude, harmonics(low, high, period), seed, roll_off=2.0)
