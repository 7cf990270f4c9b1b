"""Gears of an arm that yield: a motor moves otherwise than its link, so rotor and friction need another torque.

A gear with stiffness k that passes on the torque tau is twisted by tau / k (Spong, ASME Journal of Dynamic Systems,
Measurement, and Control 109, 1987). So a rotor of inertia J, with friction c, needs beside the torque of a stiff gear

    J/k d^2 tau / dt^2 + c/k d tau / dt

tau is that of the links from a first fit; J/k and c/k of each joint are estimated. Of both it is known beforehand how
large they are at most: that keeps them near 0 where a motion tells nothing of them, and what is not known of them is in
the covariance of all other parameters.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from joint_id_core.data.recording import Array

# A rotor swings on its gear at least at about this frequency in Hz, if the link is held: sqrt(k/J) / 2 pi. It is 15 in
# the joints of the paper's Table V, and comes out as 9 to 10 from logs of a UR10e.
SWINGS_HZ = 10.0
DAMPED = 10.0  # 1/s, viscous friction over the inertia of a rotor, at most about that
# Share of what yielding gears change in a parameter that is not known, as a standard deviation: gears are no straight
# springs. Those of Table V are three times as stiff beneath a common load as without.
NOT_STRAIGHT = 0.5


def precision(count: int) -> Array:
    """Return 1 / variance of J/k in 1/s^4 and of c/k in 1/s^2 of a number of joints, known beforehand, (2 count,)."""
    inertia = (2.0 * math.pi * SWINGS_HZ) ** -2
    return np.repeat([inertia**-2, (DAMPED * inertia) ** -2], count)


def rates(load: Array, known: NDArray[np.bool_], rate: float) -> Array:
    """Return the torques by unit J/k and c/k of each joint, (T, n, 2 n), from torques through the gears in Nm, (T, n).

    They are NaN where the motion is not known, (T,); `rate` is that of the samples.
    """
    first, second = np.full_like(load, np.nan), np.full_like(load, np.nan)
    for piece in np.split(np.arange(len(known)), np.flatnonzero(np.diff(known)) + 1):
        if known[piece[0]] and len(piece) > 1:
            first[piece] = np.gradient(load[piece], 1.0 / rate, axis=0)
            second[piece] = np.gradient(first[piece], 1.0 / rate, axis=0)
    own = np.eye(load.shape[1])
    return np.concatenate([second[:, :, None] * own, first[:, :, None] * own], axis=2)


def with_yielding(values: Array, covariance: Array, places: NDArray[np.intp]) -> Array:
    """Return a covariance (P, P) with what a straight spring may lack; values (P,), and places of J/k and c/k."""
    own = covariance[np.ix_(places, places)]
    shift = NOT_STRAIGHT * covariance[:, places] @ np.linalg.pinv(own, hermitian=True) @ values[places]
    return np.asarray(covariance + np.outer(shift, shift))
