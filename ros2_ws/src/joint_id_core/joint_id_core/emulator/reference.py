"""Reference motion of the emulated joints: a multisine each, whose speed can change."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from joint_id_core.simulation.excitation import position_reference

TICK_S = 0.002  # of the control loop
START_S, STOP_S = 0.5, 0.2  # s, from rest to the full speed of the reference, and back to rest
_DETOUR_S = 0.1  # s, time constant with which joints return to the reference path after they were held elsewhere
# Of an arm, as in recordings made to identify one: its gears then yield little beside what they are accelerated.
# After a period it repeats, and tells nothing new.
_LOW_HZ, _HIGH_HZ, _PERIOD_S = 0.1, 1.0, 60.0

Six = list[float]


class Reference:
    """Reference positions of the joints along a fixed path with variable speed.

    `pace` is the speed along the path, 1 in normal motion. It changes smoothly, so the joints start from rest and stop
    without a jump. The attributes `q`, `qd`, `qdd` hold the present reference of six joints (rad, rad/s, rad/s^2).

    Args:
        home: centre of the motion in rad, by joint.
        moving: indices of the joints that move.
        amplitude: peak of the motion in rad.
        slow: whether the tones are those for an arm whose links act on each other.
    """

    def __init__(self, home: Sequence[float], moving: Collection[int], amplitude: float, slow: bool = False) -> None:
        peaks = [amplitude if j in moving else 0.0 for j in range(len(home))]
        band = {"low": _LOW_HZ, "high": _HIGH_HZ, "period": _PERIOD_S} if slow else {}
        waves = [position_reference(peak, **band, seed=1 + j) for j, peak in enumerate(peaks)]
        omega = 2.0 * math.pi * np.array(waves[0].frequencies)  # the same tones for every joint
        self._turn = 1j * omega
        self._phasors = np.array([w.amplitudes for w in waves]) * np.exp(1j * np.array([w.phases for w in waves]))
        self._derivatives = np.stack([np.ones_like(omega), 1j * omega, -(omega**2)], axis=1)
        self._home = np.array(home)
        self._detour = np.zeros((3, len(home)))  # decaying offset from the path, and its derivatives along the path
        self._path = 0.0  # s along the path
        self._ramp = 0.0  # 0: at rest, 1: full speed
        self.q: Six
        self.qd: Six
        self.qdd: Six
        self._evaluate(0.0)

    @property
    def pace(self) -> float:
        """Speed along the path: 0 at rest, 1 at full speed."""
        return self._ramp * self._ramp * (3.0 - 2.0 * self._ramp)

    def tick(self, go: bool) -> None:
        """Advance by one tick: with `go` towards full speed, else towards rest."""
        before = self.pace
        self._ramp = min(1.0, self._ramp + TICK_S / START_S) if go else max(0.0, self._ramp - TICK_S / STOP_S)
        forward = 0.5 * (before + self.pace) * TICK_S
        self._path += forward
        self._detour *= math.exp(-forward / _DETOUR_S)
        self._evaluate((self.pace - before) / TICK_S)

    def begin_at(self, q: Sequence[float]) -> None:
        """Rest at positions `q` in rad; from there the joints later return to the path."""
        self._ramp = 0.0
        course = (self._phasors @ np.exp(self._turn * self._path)).real + self._home
        away = np.array(q) - course
        self._detour = np.stack([away, -away / _DETOUR_S, away / _DETOUR_S**2])
        self._evaluate(0.0)

    def _evaluate(self, change_of_pace: float) -> None:
        phasors = self._phasors * np.exp(self._turn * self._path)
        value, rate, curvature = (phasors @ self._derivatives).real.T + self._detour
        pace = self.pace
        self.q = (self._home + value).tolist()
        self.qd = (rate * pace).tolist()
        self.qdd = (curvature * pace**2 + rate * change_of_pace).tolist()
