"""The equation of a joint without the instants at which it sticks.

A joint that reverses sticks until the drive overcomes its friction. Meanwhile its friction is what the drive is, not
what a law of the velocity says, and behind a low-pass the velocity does not tell when it breaks away. Both sides of an
equation may be multiplied by the same weights before they pass the low-pass of the band, so nothing else changes if
these instants get none. With them, tau_f of a simulated joint in slow motion came out 8 % too large and c 6 % too
small, 22 and 16 standard deviations; without them both are right to 0.4 %.

Where friction is no straight line over all speeds, as on real robots, what is left out matters. So this is for joints
whose sliding motion shows that it is one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from joint_id_core.data.recording import Array
from joint_id_core.estimators.regression.least_squares import Solution
from joint_id_core.estimators.regression.missing import EYRING, STRIBECK

SLOW = 0.05  # of the rms velocity: below, the joint may stick
SMEARED = 0.5  # of a period of the low-pass of the motion, by which a breakaway seems earlier or later
EDGE = 0.5  # of a period of the band, in which the weights rise: sharper edges bring noise from above it into the band
# Largest share of the rms torque that friction may have beside a straight line, with two standard deviations. On UR
# robots it is 0.04 to 0.5, in simulated joints with motion enough 0.0004 to 0.02.
BENT = 0.025
BENT_BY = (STRIBECK, EYRING)  # options of friction that is no straight line


def sliding(velocity: Array, period: float, motion_hz: float, band_hz: float) -> Array:
    """Return weights from 0 (the joint may stick) to 1, shape (T,).

    Args:
        velocity: behind the low-pass of the motion, NaN where unknown, shape (T,).
        period: of the samples in s.
        motion_hz, band_hz: see `signals.Bands`.
    """
    slow = ~(np.abs(velocity) > SLOW * np.sqrt(np.nanmean(velocity**2)))
    smeared, edge = (max(1, int(share / (hz * period))) for share, hz in ((SMEARED, motion_hz), (EDGE, band_hz)))
    sticks = maximum_filter1d(slow.astype(float), 2 * (smeared + 2 * edge) + 1)
    for _ in range(2):  # the edges become parabolas
        sticks = uniform_filter1d(sticks, 2 * edge + 1)
    return np.asarray(np.clip(1.0 - sticks, 0.0, 1.0))


@dataclass(frozen=True)
class Sliding:
    """An equation at the samples that are compared, with these weights, in the band.

    Attributes:
        y, columns: shapes (R, 1) and (R, k).
        change: of the drive's part of y in a sample, shape (R, 1).
        lacked: columns (R, m) of torques that the model lacks, by the option that adds them.
    """

    y: Array
    columns: Array
    change: Array
    lacked: Mapping[str, Array]

    def straight(self, ask: Callable[[Array, Array], Solution]) -> bool:
        """Return whether the data tell that friction is a straight line; `ask` solves an equation y = columns."""
        torque = np.sqrt(np.mean(self.y**2))
        bent = [self.lacked[name] for name in BENT_BY if name in self.lacked]
        for column in np.hstack(bent).T if bent else ():
            found = ask(self.y[:, 0], np.column_stack([self.columns, column]))
            most = abs(found.values[-1]) + 2.0 * np.sqrt(found.covariance[-1, -1])
            if not most * np.sqrt(np.mean(column**2)) < BENT * torque:
                return False
        return bool(bent)
