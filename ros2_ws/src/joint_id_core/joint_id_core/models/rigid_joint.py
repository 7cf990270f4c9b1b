"""A joint or axis without flexibility, for robots with one encoder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from joint_id_core.data.signals import Parameter, Signal, channel, positive
from joint_id_core.models.base import Model, Ops
from joint_id_core.models.friction import Friction
from joint_id_core.models.transmission import (
    Actuation,
    drive_parameters,
    drive_signal,
    drive_torque,
    gear_ratio,
    gravity_parameters,
    gravity_torque,
)

# rad/s. Axes move at 0.1 m/s or at 3 rad/s, so it is 1 % of the speed at most. With 0.01 rad/s a joint at 1 rad/s that
# reverses often seemed to have another friction law.
SMOOTHING = 0.001


@dataclass(frozen=True)
class RigidJoint(Model):
    """J ddq + friction(dq) + tau_0 + gravity = N tau_m - tau_ext, all at the link.

    N is 1 unless it is set, so a recorded torque is taken as the torque (or force, for a linear axis) at
    the link. If the motor's torque or current was recorded, set the gear ratio.
    """

    name = "rigid_joint"
    summary = "rigid joint or linear axis with friction and offset, one encoder"

    actuation: Actuation = "torque"
    friction: str = "coulomb_viscous"
    gravity: bool = False

    @cached_property
    def _friction(self) -> Friction:
        return Friction(
            "link_velocity",
            positive("c", "Nm s/rad", "viscous friction", 10.0),
            positive("tau_f", "Nm", "Coulomb friction", 5.0),
            side="", w_s=SMOOTHING, w_typical=1.0, law=self.friction,
        )  # fmt: skip

    @cached_property
    def states(self) -> tuple[Signal, ...]:
        return (channel("link_position"), channel("link_velocity"))

    @cached_property
    def inputs(self) -> tuple[Signal, ...]:
        return (drive_signal(self.actuation), channel("external_torque"))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            positive("J", "kg m^2", "inertia seen at the link (mass in kg for a linear axis)", 1.0, group="load"),
            *self._friction.parameters,
            Parameter("tau_0", "Nm", "torque offset", 0.0, -1e4, 1e4, spread=10.0, of_recording=True),
            gear_ratio(1.0),
            *drive_parameters(self.actuation),
            *(gravity_parameters() if self.gravity else ()),
        )

    def derivative(self, x: Sequence[Any], u: Sequence[Any], p: Any, ops: Ops) -> tuple[Any, ...]:
        q, w_q = x
        drive, tau_ext = u
        load = self._friction.torque(w_q, p, ops) + p.tau_0 + tau_ext
        if self.gravity:
            load = load + gravity_torque(q, p, ops)
        return (w_q, (p.N * drive_torque(self.actuation, drive, p) - load) / p.J)
