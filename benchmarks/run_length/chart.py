"""The control chart of the drift monitor on estimates drawn from their exact distribution.

The error of an estimate with memory is a stationary Gaussian process of first order: in units of its standard deviation
e_n = a e_(n-1) + sqrt(1 - a^2) w_n with a = exp(-hop / memory). The baseline is such an estimate too, at the begin.
All sizes are in standard deviations of one estimate; the difference of two has sqrt(2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from joint_id_core.data.recording import Array

HOP_S, MEMORY_S = 0.5, 60.0  # the defaults of the identifier
KEPT = math.exp(-HOP_S / MEMORY_S)
HOUR = 3600.0
SETTLED = 10.0  # memories between the baseline and a change


@dataclass(frozen=True)
class Alarms:
    """False alarms at one threshold: how many in how many hours of motion of one parameter."""

    count: int
    hours: float

    @property
    def text(self) -> str:
        """Mean hours of motion between two, with the standard error of the mean in per cent."""
        if self.count < 5:
            return f"more than {_rounded(self.hours / 5.0)}"
        return f"{_rounded(self.hours / self.count)} ± {100.0 / math.sqrt(self.count):.0f} %"


def _rounded(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):,.4g}" if value < 1000.0 else f"{float(f'{value:.2g}'):,.0f}"


def false_alarms(
    thresholds: Array, tolerance: float, shift: float, joints: int, hours: float, confirm_s: float, seed: int
) -> list[Alarms]:
    """Alarms of parameters that differ from the baseline by a constant `shift`, each watched for so many hours."""
    steps, confirm = round(hours * HOUR / HOP_S), round(confirm_s / HOP_S)
    counts = _count(np.asarray(thresholds, dtype=float), tolerance, shift, joints, steps, confirm, seed)
    return [Alarms(int(count), joints * hours) for count in counts]


def delays(
    threshold: float, tolerance: float, change: float, joints: int, longest_s: float, confirm_s: float, seed: int
) -> Array:
    """Time in s from a sudden change until it is reported, shape (joints,); inf where that takes longer."""
    confirm = round(confirm_s / HOP_S)
    steps = _delays(threshold, tolerance, change, joints, round(longest_s / HOP_S), confirm, seed)
    return np.where(steps < 0, np.inf, steps * HOP_S)


@numba.njit(cache=False)
def _count(
    thresholds: Array, tolerance: float, shift: float, joints: int, steps: int, confirm: int, seed: int
) -> Array:
    np.random.seed(seed)
    counts = np.zeros(len(thresholds))
    fresh = math.sqrt(1.0 - KEPT * KEPT)
    for _ in range(joints):
        baseline = np.random.standard_normal()
        error = baseline
        told = np.zeros(len(thresholds), dtype=np.bool_)
        far = np.zeros(len(thresholds), dtype=np.int64)  # estimates that were far off, one after the other
        above = True
        for _ in range(steps):
            error = KEPT * error + fresh * np.random.standard_normal()
            difference = shift + error - baseline
            beyond = abs(difference) - tolerance
            if beyond <= 0.0 or above != (difference > 0.0):
                told[:] = False
                far[:] = 0
            above = difference > 0.0
            if beyond <= 0.0:
                continue
            for k in range(len(thresholds)):
                far[k] = far[k] + 1 if beyond > thresholds[k] * math.sqrt(2.0) else 0
                if not told[k] and far[k] > confirm:
                    told[k] = True
                    counts[k] += 1
    return counts


@numba.njit(cache=False)
def _delays(
    threshold: float, tolerance: float, change: float, joints: int, steps: int, confirm: int, seed: int
) -> Array:
    np.random.seed(seed)
    found = np.full(joints, -1)
    fresh = math.sqrt(1.0 - KEPT * KEPT)
    old = math.exp(-SETTLED)
    for joint in range(joints):
        baseline = np.random.standard_normal()
        error = old * baseline + math.sqrt(1.0 - old * old) * np.random.standard_normal()
        far = 0
        seen = 0.0  # share of the change that the estimate shows
        for step in range(1, steps + 1):
            error = KEPT * error + fresh * np.random.standard_normal()
            seen = KEPT * seen + (1.0 - KEPT)
            far = far + 1 if abs(seen * change + error - baseline) - tolerance > threshold * math.sqrt(2.0) else 0
            if far > confirm:
                found[joint] = step
                break
    return found
