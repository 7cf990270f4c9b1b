"""Voltage, current and velocity of a motor against its circuit, v = R i + L di/dt + k_b w (paper Eq 4).

A resistance and a voltage constant are positive in any motor, so the recording shows a wrong sign or column by itself.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from joint_id_core.checking.finding import Finding
from joint_id_core.data.recording import Array, Recording

CHANNELS = ("voltage", "current", "motor_velocity")
STRETCHES, SHOWING, ROWS = 8, 3, 50  # of a recording; those at least that show it; samples in one at least
EXPLAINED = 0.8  # share of the variance of the voltage that is of the circuit at least
# A term shows its sign where the rest explains less by this share of the variance, and this many times what is left.
SHARE, NEEDED = 0.03, 3.0
RESISTANCES = (2e-3, 100.0)  # Ohm, of motors of robots, with a wide margin
_CONTRADICTIONS = {  # by the signs of R and k_b; 0 is not known
    (-1, 1): "the resistance is negative: current has the wrong sign",
    (-1, 0): "the resistance is negative: current or voltage has the wrong sign",
    (1, -1): "the voltage constant is negative: motor_velocity has the wrong sign, or voltage and current are swapped",
    (0, -1): "the voltage constant is negative: motor_velocity or voltage has the wrong sign",
    (-1, -1): "resistance and voltage constant are negative: voltage has the wrong sign",
}


def circuit(recording: Recording) -> Iterator[Finding]:
    """Find signs, columns and units of the motor's signals that contradict its circuit."""
    if not all(recording.measured(name) for name in CHANNELS):
        return
    rows = _steps(np.column_stack([recording[name] for name in CHANNELS]))
    if len(rows) < STRETCHES * ROWS:
        return
    whole, explained = _fitted(rows)
    if explained < EXPLAINED:
        return
    resistance, (of_resistance, of_constant) = float(whole[0]), _signs(rows).tolist()
    if contradiction := _CONTRADICTIONS.get((of_resistance, of_constant)):
        yield Finding(
            f"Voltage, current and motor_velocity contradict each other: {contradiction}; convert it (--map)",
            CHANNELS,
            fatal=True,
        )
    elif of_resistance > 0 and not RESISTANCES[0] < resistance < RESISTANCES[1]:
        unit = "current seems to be in mA" if resistance < RESISTANCES[0] else "voltage seems to be in mV"
        yield Finding(
            f"Voltage and current are those of a motor of {resistance:.2g} Ohm, which no robot has: {unit}; convert it "
            "(--map)",
            CHANNELS,
            fatal=True,
        )


def _steps(samples: Array) -> Array:
    """Return the means of two samples that follow each other (T, 3), and the changes of voltage and current: (n, 5).

    The change of the current stands for the inductance, that of the voltage for what it did between the two samples.
    """
    means, changes = 0.5 * (samples[1:] + samples[:-1]), samples[1:] - samples[:-1]
    rows = np.column_stack([means, changes[:, :2]])
    return np.asarray(rows[np.isfinite(rows).all(axis=1)])


def _fitted(rows: Array, without: int | None = None) -> tuple[Array, float]:
    """Return the factors of current and velocity in the voltage, and the share of its variance that is explained.

    A column of the rows (n, 5) that is left out has the factor 0.
    """
    regressors = np.column_stack([rows[:, 1:], np.ones(len(rows))])
    if without is not None:
        regressors[:, without] = 0.0
    scale = np.abs(regressors).max(axis=0)
    scale[scale == 0.0] = 1.0
    found = np.linalg.lstsq(regressors / scale, rows[:, 0], rcond=None)[0] / scale
    variance = float(np.var(rows[:, 0]))
    left = float(np.var(rows[:, 0] - regressors @ found))
    return found[:2], 1.0 - left / variance if variance > 0.0 else 0.0


def _signs(rows: Array) -> NDArray[np.int64]:
    """Return the signs of R and k_b that all stretches agree on, 0 where they do not or too few show it."""
    shown = [_signs_in(part) for part in np.array_split(rows, STRETCHES)]
    return np.array([_common([signs[k] for signs in shown if signs[k]]) for k in range(2)], dtype=np.int64)


def _common(signs: list[int]) -> int:
    return signs[0] if len(signs) >= SHOWING and len(set(signs)) == 1 else 0


def _signs_in(rows: Array) -> tuple[int, int]:
    """Return the signs of R and k_b in one stretch, 0 where this term is not larger than what the equation leaves."""
    found, explained = _fitted(rows)
    if explained < EXPLAINED:
        return 0, 0
    least = max(SHARE, NEEDED * (1.0 - explained))
    needed = [explained - _fitted(rows, without=k)[1] > least for k in range(2)]
    first, second = (int(np.sign(value)) if need else 0 for value, need in zip(found, needed, strict=True))
    return first, second
