"""Whether the recorded drive is late or early against the motion that it makes."""

from __future__ import annotations

import numpy as np

from joint_id_core.checking.shift import Shift, best_shift
from joint_id_core.data.recording import Array
from joint_id_core.filtering.offline import interpolate

LONGEST_S = 0.1  # that is looked for
PERIODS = 2.5  # the same in periods of the band, which reaches to ten times the frequency of the motion
LEAST_ROWS = 100


def drive_shift(time: Array, drive: Array, at: Array, y: Array, columns: Array, band_hz: float) -> Shift | None:
    """Return by how many s the drive of an equation is late; None if it cannot be told.

    Args:
        time: instants in s, shape (T,).
        drive: its part of the known terms at these, in the band, shape (T,), NaN where unknown.
        at: instants of the equation in s, shape (R,).
        y, columns: the known terms (R,), and the columns (R, k).
        band_hz: of both.
    """
    known = np.isfinite(drive)
    time, drive = time[known], drive[known]
    if len(time) < LEAST_ROWS:
        return None
    period = float(np.median(time[1:] - time[:-1]))
    most = max(3, int(min(LONGEST_S, PERIODS / band_hz) / period))
    reach = (most + 1) * period
    inside = (at > time[0] + reach) & (at < time[-1] - reach)
    if np.count_nonzero(inside) < LEAST_ROWS:
        return None
    at, y, columns = at[inside], y[inside], columns[inside]
    now = interpolate(at, time, drive)

    def known_terms(late: float) -> Array:
        return np.asarray(y - now + interpolate(at + late * period, time, drive))

    found = best_shift(known_terms, columns, most)
    return None if found is None else found.scaled(period)


def when(late: Shift) -> str:
    """Return in words how late or early a drive is."""
    return f"{1e3 * abs(late.late):.3g} ms {'late' if late.late > 0.0 else 'early'}"
