"""Flexible joints whose links act on each other: an arm.

Every joint is one of Model 2 (motor, gear, friction on both sides) with the links in place of its own load. Motors and
links of all joints advance together by the trapezoidal rule, linearised once a step, so that stiff gears and light
links need no small steps. Coulomb friction sticks exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, ClassVar, Protocol

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.models import HarmonicDrive
from joint_id_core.models.operations import ArrayOps
from joint_id_core.simulation.coupled_friction import with_friction

STEP_S = 5e-4  # at most
_TINY = 1e-30  # imaginary step of the derivatives (Squire & Trapp 1998)
_STATES = 4  # motor position, link position, motor velocity, link velocity
# Columns that are computed at once: the forces, their derivatives by the states, and the forces with Coulomb friction
# of the motors and of the links.
_MOTOR, _LINK, _COLUMNS = 1 + _STATES, 2 + _STATES, 3 + _STATES


class Links(Protocol):
    """The rigid links of an arm."""

    def dynamics(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the mass matrix (n, n) in kg m^2, and the torques of gravity and velocities (n,) in Nm."""


class _Directions(ArrayOps):
    """Directions of sliding by column: without Coulomb friction, but for one column each."""

    _COLUMN: ClassVar = {v: np.eye(_COLUMNS)[:, [k]] for v, k in (("motor_velocity", _MOTOR), ("link_velocity", _LINK))}

    @classmethod
    def direction(cls, velocity: str, w: Any, w_s: Any) -> Any:
        """Return them, shape (columns, 1)."""
        return cls._COLUMN[velocity]


class CoupledJoints:
    """Joints at rest at first; `advance` moves them.

    Attributes:
        motor_position, motor_velocity, link_position, link_velocity: at present, in SI units at the motor shaft and at
            the link, shape (n,).

    Args:
        values: parameters of each joint (`HarmonicDrive`, driven by a current), SI units. J_q is not used: the inertia
            is that of the links.
        links: their links.
        link_position: where they rest, in rad, shape (n,); the gears carry the gravity of the links.

    Raises:
        JointIdError: a value out of bounds.
    """

    def __init__(self, values: Sequence[Mapping[str, float]], links: Links, link_position: Sequence[float]) -> None:
        self._model, self._links = HarmonicDrive(actuation="current"), links
        # With an inertia of 1 kg m^2, the acceleration of a link is the torque on it.
        rows = [self._model.values({**v, "J_q": 1.0}) for v in values]
        self._p = SimpleNamespace(**{name: np.array([row[name] for row in rows]) for name in rows[0]})
        count = len(rows)
        q = np.asarray(link_position, dtype=float)
        self._state = np.array([self._p.N * (q + self._twist(q, rows)), q, np.zeros(count), np.zeros(count)])
        self._change = np.zeros(count)  # of the link velocities in the step before
        self._modes = np.zeros(2 * count)
        self._weights = np.array([self._p.J_m, np.ones(count)])[:, None, :]
        self._matrix = np.empty((2 * count, 2 * count))  # motors, then links
        self._own = np.einsum("aibi->abi", self._matrix.reshape(2, count, 2, count))  # of each joint alone: a view
        self._between_links = self._matrix[count:, count:]
        self._shifts = np.zeros((_STATES, _COLUMNS, 1), dtype=complex)
        self._shifts[np.arange(_STATES), 1 + np.arange(_STATES)] = 1j * _TINY

    def _twist(self, q: Array, rows: Sequence[Mapping[str, float]]) -> Array:
        """Return the twists of the gears that carry gravity."""
        currents = self._links.dynamics(q, np.zeros(len(q)))[1] / (self._p.N * self._p.k_t)
        pairs = zip(currents.tolist(), rows, strict=True)
        return np.array([self._model.twist_under(i, 0.0, 0.0, SimpleNamespace(**row)) for i, row in pairs])

    @property
    def motor_position(self) -> Array:
        """Positions of the motors."""
        return self._state[0].copy()

    @property
    def link_position(self) -> Array:
        """Positions of the links."""
        return self._state[1].copy()

    @property
    def motor_velocity(self) -> Array:
        """Velocities of the motors."""
        return self._state[2].copy()

    @property
    def link_velocity(self) -> Array:
        """Velocities of the links."""
        return self._state[3].copy()

    def rest(self) -> None:
        """Stop at the present positions."""
        self._state[2:] = 0.0
        self._change[:] = 0.0
        self._modes[:] = 0.0

    def advance(self, dt: float, current: Sequence[float]) -> None:
        """Advance by `dt` in s under the motor currents in A, which are held, shape (n,).

        Raises:
            JointIdError: the motion is not finite.
        """
        drive = np.asarray(current, dtype=float)
        steps = int(np.ceil(dt / STEP_S - 1e-9))
        for _ in range(steps):
            self._step(dt / steps, drive)

    def _step(self, h: float, drive: Array) -> None:
        old = self._state[2:]
        force, slopes, coulomb = self._forces(drive)
        inertia, bias = self._links.dynamics(self._state[1] + 0.5 * h * old[1], old[1] + 0.5 * self._change)
        force[1] -= bias
        stiffness, damping = slopes[:, :2], slopes[:, 2:]
        # M dv = h (f + (K dx + D dv) / 2) with dx = h (v + dv / 2); the unknown is v + dv.
        self._matrix[:] = 0.0
        self._own[:] = -0.5 * h * (damping + 0.5 * h * stiffness)
        self._own[0, 0] += self._p.J_m
        self._between_links += inertia
        impulse = self._matrix @ old.ravel() + (h * (force + 0.5 * h * (stiffness * old).sum(axis=1))).ravel()
        try:
            found, self._modes = with_friction(self._matrix, impulse, h * coulomb.ravel(), self._modes)
        except (JointIdError, np.linalg.LinAlgError):
            raise JointIdError("the motion of the arm is not finite: check its description and parameters") from None
        new = found.reshape(old.shape)
        self._state[:2] += 0.5 * h * (old + new)
        self._change = new[1] - old[1]
        self._state[2:] = new

    def _forces(self, drive: Array) -> tuple[Array, Array, Array]:
        """Return torques on motors and links, their derivatives by the states, and the size of Coulomb friction.

        Torques are without that friction. Shapes (2, n), (2, 4, n), (2, n), from one call of the model.
        """
        x = self._state[:, None, :] + self._shifts
        rates = np.array(self._model.derivative(tuple(x), (drive, 0.0), self._p, _Directions)[2:])
        torques = rates * self._weights
        plain = torques.real
        coulomb = np.array([plain[0, 0] - plain[0, _MOTOR], plain[1, 0] - plain[1, _LINK]])
        return plain[:, 0].copy(), torques[:, 1 : 1 + _STATES].imag / _TINY, coulomb
