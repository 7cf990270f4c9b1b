"""Six simulated joints under position control, each following its own multisine."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from joint_id_core.emulator.robots import Joint
from joint_id_core.models import HarmonicDrive
from joint_id_core.simulation.excitation import position_reference
from joint_id_core.simulation.position_control import PositionController
from joint_id_core.simulation.simulator import JointSimulator

TICK_S = 0.002  # of the control loop
START_S, STOP_S = 0.5, 0.2  # s, from rest to the full speed of the reference, and back to rest
_DETOUR_S = 0.1  # s, time constant with which joints return to the reference path after they were held elsewhere

Six = list[float]


class Reference:
    """Reference positions of the joints along a fixed path with variable speed.

    `pace` is the speed along the path, 1 in normal motion. It changes smoothly, so the joints start from rest and stop
    without a jump. The attributes `q`, `qd`, `qdd` hold the present reference of six joints (rad, rad/s, rad/s^2).

    Args:
        home: centre of the motion in rad, by joint.
        moving: indices of the joints that move.
        amplitude: peak of the motion in rad.
    """

    def __init__(self, home: Sequence[float], moving: Collection[int], amplitude: float) -> None:
        waves = [position_reference(amplitude if j in moving else 0.0, seed=1 + j) for j in range(len(home))]
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


class Arm:
    """Six joints without coupling and without gravity.

    A tick consists of `decide` (the controllers read the joints and set their currents) and `advance`. Between the two
    the attributes hold the values of this instant: `motor_position` and `motor_velocity` at the shaft,
    `link_position`, `link_velocity` in SI units, and `current` in A, which is held until the next tick.

    Raises:
        JointIdError: an amplitude that is not finite.
    """

    def __init__(self, joints: Sequence[Joint], moving: Collection[int], amplitude: float) -> None:
        self.joints = tuple(joints)
        self.reference = Reference([j.home for j in joints], moving, amplitude)
        self.braked = False
        c = PositionController()
        self._control = [PositionController(j.size * c.k_p, j.size * c.k_d, j.size * c.limit) for j in joints]
        self._model = HarmonicDrive(actuation="current")
        self._ratio = [j.values["N"] for j in joints]
        self._k_t = [j.values["k_t"] for j in joints]
        self.link_position: Six = list(self.reference.q)
        self.motor_position: Six = [q * n for q, n in zip(self.link_position, self._ratio, strict=True)]
        self.current: Six = [0.0] * len(joints)
        self._rest()
        self._simulators = self._at_rest()

    def _rest(self) -> None:
        self.motor_velocity: Six = [0.0] * len(self.joints)
        self.link_velocity: Six = [0.0] * len(self.joints)

    def _at_rest(self) -> list[JointSimulator]:
        """Return simulators of the joints at their present positions, at rest."""
        places = zip(self.joints, self.motor_position, self.link_position, strict=True)
        return [
            JointSimulator(self._model, j.values, {"motor_position": theta, "link_position": q})
            for j, theta, q in places
        ]

    def brake(self) -> None:
        """Brakes on, motors off: the joints stop at once at their present positions."""
        self.braked = True
        self.reference.begin_at(self.link_position)
        self._rest()
        self.current = [0.0] * len(self.joints)

    def release(self) -> None:
        """Brakes off, motors on: the joints start at their present positions and return to the path."""
        self.braked = False
        self._simulators = self._at_rest()

    def decide(self) -> None:
        """Set the currents of this tick."""
        if self.braked:
            return
        reference = self.reference
        for i, control in enumerate(self._control):
            torque = control.torque(
                reference.q[i], reference.qd[i], self.link_position[i], self.motor_velocity[i] / self._ratio[i]
            )
            self.current[i] = torque / self._k_t[i]

    def advance(self, go: bool) -> None:
        """Advance by one tick with the present currents; with `go` the reference moves, else it stops.

        Raises:
            JointIdError: the simulation cannot go on.
        """
        if self.braked:
            return
        for i, simulator in enumerate(self._simulators):
            simulator.advance(TICK_S, {"current": self.current[i]})
            x = simulator.state
            self.motor_position[i] = x["motor_position"]
            self.link_position[i] = x["link_position"]
            self.motor_velocity[i] = x["motor_velocity"]
            self.link_velocity[i] = x["link_velocity"]
        self.reference.tick(go)
