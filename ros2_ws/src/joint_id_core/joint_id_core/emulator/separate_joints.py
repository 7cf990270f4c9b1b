"""Joints that do not act on each other: every one is simulated by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.models import HarmonicDrive
from joint_id_core.simulation.simulator import JointSimulator


class SeparateJoints:
    """Joints of Model 2 without links and gravity, at rest at first.

    Attributes:
        motor_position, motor_velocity, link_position, link_velocity: at present, in SI units at the motor shaft and at
            the link, shape (n,).

    Args:
        values: parameters of each joint, SI units.
        link_position: where they rest, in rad, shape (n,).

    Raises:
        JointIdError: a value out of bounds.
    """

    def __init__(self, values: Sequence[Mapping[str, float]], link_position: Sequence[float]) -> None:
        self._model, self._values = HarmonicDrive(actuation="current"), values
        self.link_position = np.array(link_position)
        self.motor_position: Array = self.link_position * [v["N"] for v in values]
        self.motor_velocity = self.link_velocity = np.zeros(len(values))
        self.rest()

    def rest(self) -> None:
        """Stop at the present positions."""
        self.motor_velocity = self.link_velocity = np.zeros(len(self._values))
        places = zip(self._values, self.motor_position.tolist(), self.link_position.tolist(), strict=True)
        self._simulators = [
            JointSimulator(self._model, v, {"motor_position": theta, "link_position": q}) for v, theta, q in places
        ]

    def advance(self, dt: float, current: Sequence[float]) -> None:
        """Advance by `dt` in s under the motor currents in A, which are held, shape (n,).

        Raises:
            JointIdError: the simulation cannot go on.
        """
        for simulator, drive in zip(self._simulators, current, strict=True):
            simulator.advance(dt, {"current": drive})
        states = [simulator.state for simulator in self._simulators]
        self.motor_position, self.link_position, self.motor_velocity, self.link_velocity = (
            np.array([x[name] for x in states]) for name in self._model.state_names
        )
