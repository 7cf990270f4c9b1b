"""Plain IDIM-LS, as textbooks have it (Gautier, ICRA 1997), written without the library: least squares with sign
friction, one fixed low-pass, and a covariance for white residuals."""

from __future__ import annotations

import numpy as np
import scipy

from joint_id_core.data.recording import Array, Recording

CUTOFF_HZ = 10.0
ORDER = 4
MOVES = 0.02  # of the largest speed: slower samples are left out, a sticking joint may bear any torque
KEPT = 0.8  # decimation: samples are kept at 1 / 0.8 times the Nyquist rate of the band
NAMES = ("J", "c", "tau_f", "tau_0", "a_g", "b_g")


def plain_least_squares(recording: Recording, gravity: bool) -> tuple[dict[str, float], dict[str, float]]:
    """Values and standard deviations by name.

    Position behind a zero-phase Butterworth filter, derivatives by central differences, then the same filter for torque
    and columns; one period of the cutoff is left out at both ends.
    """
    period = float(np.median(np.diff(recording.time)))
    cutoff_hz = min(CUTOFF_HZ, 0.4 / period)
    even = np.arange(recording.time[0], recording.time[-1], period)
    sections = scipy.signal.butter(ORDER, cutoff_hz, fs=1.0 / period, output="sos")

    def low_pass(values: Array) -> Array:
        return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0))

    def sampled(name: str) -> Array:
        return np.asarray(np.interp(even, recording.time, recording[name]))

    q = low_pass(sampled("link_position"))
    w = np.gradient(q, period)
    torque = sampled("torque")
    if "external_torque" in recording:
        torque = torque - sampled("external_torque")
    columns = [np.gradient(w, period), w, np.sign(w), np.ones_like(w)]
    if gravity:
        columns += [np.cos(q), np.sin(q)]
    table = low_pass(np.column_stack([torque, *columns]))
    margin, step = int(1.0 / (cutoff_hz * period)), max(1, int(KEPT * 0.5 / (cutoff_hz * period)))
    kept = np.arange(margin, len(even) - margin, step)
    kept = kept[np.abs(w[kept]) > MOVES * np.abs(w).max()]
    y, x = table[kept, 0], table[kept, 1:]
    found, *_ = np.linalg.lstsq(x, y, rcond=None)
    variance = float(np.sum((y - x @ found) ** 2)) / (len(y) - x.shape[1])
    sigma = np.sqrt(variance * np.diag(np.linalg.inv(x.T @ x)))
    names = NAMES[: x.shape[1]]
    return dict(zip(names, found.tolist(), strict=True)), dict(zip(names, sigma.tolist(), strict=True))
