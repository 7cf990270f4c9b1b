"""The logs that all methods fit, and the motion and torque by which all are judged."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from joint_id_core.data.recording import Array, Recording

PERIOD_S = 0.01
POSITION_HZ, BAND_HZ = 20.0, 8.0  # low-pass of positions before they are differentiated, and of torques
ORDER = 4
ENDS_S = 0.5  # not judged: the filters begin and end there
MOVES = 0.02  # rad/s: below, a sticking joint may bear any torque


@dataclass(frozen=True)
class Log:
    """A log of n joints at T even instants, as peers get it.

    Attributes:
        name: of the log.
        joints: names of the joints.
        time: in s, shape (T,).
        q, torque: angles in rad, and current times gain in Nm, as they were measured, shape (T, n).
    """

    name: str
    joints: tuple[str, ...]
    time: Array
    q: Array
    torque: Array

    @classmethod
    def of(cls, recordings: Mapping[str, Recording]) -> Log:
        """The channels of recordings of all joints, at the same instants."""
        first = next(iter(recordings.values()))
        even = np.arange(first.time[0], first.time[-1], PERIOD_S)
        q, torque = (
            np.array([np.interp(even, r.time, r[name]) for r in recordings.values()]).T
            for name in ("link_position", "torque")
        )
        return cls(first.source, tuple(recordings), even - even[0], q, torque)

    def motion(self, cutoff_hz: float = POSITION_HZ) -> tuple[Array, Array, Array]:
        """Angles below a frequency, and their central differences, each of shape (T, n)."""
        q = low_pass(self.q, cutoff_hz)
        dq = np.gradient(q, PERIOD_S, axis=0)
        return q, dq, np.gradient(dq, PERIOD_S, axis=0)

    @cached_property
    def judged(self) -> slice:
        """Samples that count."""
        ends = round(ENDS_S / PERIOD_S)
        return slice(ends, len(self.time) - ends)

    def r_squared(self, predicted: Array, in_motion: bool = False) -> tuple[float, ...]:
        """R2 of the torque of each joint below 8 Hz, from a prediction (T, n).

        Both are taken about their means: an offset changes from log to log. `in_motion`: of samples at which the joint
        moves; NaN where it never does.
        """
        moves = np.abs(self.motion()[1]) > (MOVES if in_motion else -1.0)
        found = []
        for j, some in enumerate(moves[self.judged].T):
            y, error = (low_pass(t[:, j], BAND_HZ)[self.judged][some] for t in (self.torque, self.torque - predicted))
            known = len(y) > 0 and np.var(y) > 0.0
            found.append(1.0 - float(np.var(error) / np.var(y)) if known else float("nan"))
        return tuple(found)


def low_pass(values: Array, cutoff_hz: float) -> Array:
    """Values (T, ...) below a frequency: a Butterworth filter forwards and backwards."""
    sections = scipy.signal.butter(ORDER, cutoff_hz, fs=1.0 / PERIOD_S, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0))


def without_meshes(text: str) -> str:
    """A URDF without shapes, whose files two of the peers would look for."""
    root = ET.fromstring(text)
    for link in root.iter("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(part)
    return ET.tostring(root, encoding="unicode")
