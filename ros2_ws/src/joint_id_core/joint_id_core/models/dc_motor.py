"""Model 1 of the paper: the motor of the joint, electrical and mechanical (Eqs 4 to 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from joint_id_core.data.signals import Parameter, Signal, channel, positive
from joint_id_core.models.base import Model, Ops
from joint_id_core.models.friction import Friction

# The paper gives neither L nor J_r. This L gives an electrical time constant L/R of about 1 ms, which is usual for a
# motor of this size. J_r is the rotor inertia that Table V states for the UR3e.
INDUCTANCE = 5e-4
ROTOR_INERTIA = 6e-5


def electrical_parameters(fixed_inductance: bool = True) -> tuple[Parameter, ...]:
    """Return R, L and k_b (paper Eq 4, values of Table I). In the paper L is known from the data sheet."""
    return (
        positive("R", "Ohm", "armature resistance", 4.932e-1),
        Parameter("L", "H", "armature inductance", INDUCTANCE, lower=0.0, fixed=fixed_inductance),
        positive("k_b", "V s/rad", "back electromotive force constant", 5.794e-2),
    )


@dataclass(frozen=True)
class DCMotor(Model):
    """Model 1: states current and motor velocity, inputs voltage and load torque."""

    name = "dc_motor"
    summary = "DC motor, electrical and mechanical (paper Model 1)"

    friction: str = "coulomb_viscous"

    @cached_property
    def _friction(self) -> Friction:
        return Friction(
            "motor_velocity",
            positive("c_b", "Nm s/rad", "viscous friction of the bearing", 2.537e-4),
            positive("tau_fc", "Nm", "Coulomb friction of the motor", 4.464e-2),
            side="m", w_s=0.03, w_typical=100.0, law=self.friction,
        )  # fmt: skip

    @cached_property
    def states(self) -> tuple[Signal, ...]:
        return (channel("current"), channel("motor_velocity"))

    @cached_property
    def inputs(self) -> tuple[Signal, ...]:
        return (channel("voltage"), channel("external_torque"))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            *electrical_parameters(),
            positive("k_t", "Nm/A", "torque constant", 5.507e-2),
            Parameter("J_r", "kg m^2", "rotor inertia", ROTOR_INERTIA, lower=0.0, fixed=True),
            *self._friction.parameters,
        )

    def derivative(self, x: Sequence[Any], u: Sequence[Any], p: Any, ops: Ops) -> tuple[Any, ...]:
        i, w_m = x
        v_s, tau_ext = u
        di = (v_s - p.R * i - p.k_b * w_m) / p.L
        dw_m = (p.k_t * i - self._friction.torque(w_m, p, ops) - tau_ext) / p.J_r
        return (di, dw_m)
