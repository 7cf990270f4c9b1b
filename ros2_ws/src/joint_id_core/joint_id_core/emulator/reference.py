"""Reference motion of the emulated joints: along a path, with a speed that can change."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.emulator.paths import Path, Rest

TICK_S = 0.002  # of the control loop
START_S, STOP_S = 0.5, 0.2  # s, from rest to the full speed of the reference, and back to rest

Six = list[float]


class Reference:
    """Reference positions of the joints along a path with variable speed.

    `pace` is the speed along the path, 1 in normal motion. It changes smoothly, so the joints start from rest and stop
    without a jump. The attributes `q`, `qd`, `qdd` hold the present reference of the joints (rad, rad/s, rad/s^2).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._next: Callable[[Array], Path] | None = None  # path to take from where the joints come to rest
        self._along = 0.0  # s along the path
        self._ramp = 0.0  # 0: at rest, 1: full speed
        self.q: Six
        self.qd: Six
        self.qdd: Six
        self._evaluate(0.0)

    @property
    def pace(self) -> float:
        """Speed along the path: 0 at rest, 1 at full speed."""
        return self._ramp * self._ramp * (3.0 - 2.0 * self._ramp)

    def take(self, path: Callable[[Array], Path]) -> None:
        """Come to rest, then take the path that is made for the positions there, in rad, shape (joints,)."""
        self._next = path

    def stop(self) -> None:
        """Come to rest, and stay there."""
        self.take(Rest)

    def tick(self, go: bool) -> None:
        """Advance by one tick: with `go` towards full speed, else towards rest."""
        before = self.pace
        go = go and self._next is None
        self._ramp = min(1.0, self._ramp + TICK_S / START_S) if go else max(0.0, self._ramp - TICK_S / STOP_S)
        self._along += 0.5 * (before + self.pace) * TICK_S
        self._evaluate((self.pace - before) / TICK_S)
        if self._next is not None and self._ramp == 0.0:
            self._path, self._along, self._next = self._next(np.array(self.q)), 0.0, None

    def begin_at(self, q: Sequence[float]) -> None:
        """Rest at positions `q` in rad; from there the joints later return to a path of their own."""
        self._ramp = 0.0
        if self._next is not None:
            self._path, self._along, self._next = Rest(np.array(q)), 0.0, None
        self._path = self._path.resumed(self._along, np.array(q))
        self._evaluate(0.0)

    def _evaluate(self, change_of_pace: float) -> None:
        point, pace = self._path.at(self._along), self.pace
        self.q = point.value.tolist()
        self.qd = (point.rate * pace).tolist()
        self.qdd = (point.curvature * pace**2 + point.rate * change_of_pace).tolist()
