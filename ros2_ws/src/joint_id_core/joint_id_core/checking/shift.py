"""By how much a signal is late against a linear combination of others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.data.recording import Array

BLOCKS = 16  # stretches whose scatter tells the uncertainty: they are long against the memory of what is left
COARSE = 16  # shifts to either side that are tried first
SURE = 6.0  # standard deviations, which 16 blocks tell: Student's t exceeds it once in 40,000 times, 4 once in 900


@dataclass(frozen=True)
class Shift:
    """How late a signal is, in units of its argument.

    Attributes:
        late, sigma: value and standard deviation.
        explained: share of the variance of the signal that the columns explain with this shift; `before`: without.
        factors: of the columns, shape (k,).
    """

    late: float
    sigma: float
    explained: float
    before: float
    factors: Array

    @property
    def sure(self) -> bool:
        """Whether it differs from zero by far more than its uncertainty."""
        return abs(self.late) > SURE * self.sigma

    def scaled(self, unit: float) -> Shift:
        """Return it in another unit."""
        return replace(self, late=self.late * unit, sigma=self.sigma * unit)


def best_shift(signal: Callable[[float], Array], columns: Array, most: int) -> Shift | None:
    """Return the shift s of at most `most` for which least squares of signal(s) (T,) on columns (T, k) leaves least.

    None if there is no such minimum within these limits.
    """
    basis = np.linalg.qr(columns)[0]

    def left(rows: Array) -> Array:
        return np.asarray(rows - basis @ (basis.T @ rows))

    def size(shift: int) -> float:
        rows = signal(float(shift))
        return _share(left(rows), rows)

    coarse = max(1, most // COARSE)
    sizes = {k: size(k) for k in range(-coarse * (most // coarse), most + 1, coarse)}
    best = min(sizes, key=sizes.__getitem__)
    sizes |= {k: size(k) for k in range(max(-most, best - coarse + 1), min(most, best + coarse - 1) + 1)}
    best = min(sizes, key=sizes.__getitem__)
    if abs(best) >= most:
        return None
    middle = float(best)
    for _ in range(2):  # Gauss-Newton; the slope is that of a parabola through three shifts
        rows = signal(middle)
        slope, rest = left(signal(middle + 0.5) - signal(middle - 0.5)), left(rows)
        energy = float(slope @ slope)
        if energy == 0.0:
            return None
        middle -= float(np.clip(slope @ rest / energy, -1.0, 1.0))
    rows = signal(middle)
    rest = left(rows)
    scores = np.add.reduceat(slope * rest, np.linspace(0, len(rest), BLOCKS, endpoint=False).astype(int))
    sigma = float(np.sqrt(BLOCKS * np.var(scores, ddof=1))) / energy
    factors = np.asarray(np.linalg.lstsq(columns, rows, rcond=None)[0], dtype=float)
    explained = 1.0 - _share(rest, rows)
    return Shift(middle, sigma, explained, 1.0 - size(0), factors)


def _share(part: Array, whole: Array) -> float:
    """Return the variance of one signal over that of the other; 1 if both are constant."""
    variance = float(np.var(whole))
    return float(np.var(part)) / variance if variance > 0.0 else 1.0
