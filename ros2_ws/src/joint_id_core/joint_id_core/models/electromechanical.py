"""Model 3 of the paper: Models 1 and 2 combined (Eq 12)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from joint_id_core.data.signals import Parameter, Signal, channel, positive
from joint_id_core.models.base import Model, Ops
from joint_id_core.models.dc_motor import electrical_parameters
from joint_id_core.models.friction import Friction
from joint_id_core.models.harmonic_drive import link_friction, motor_friction
from joint_id_core.models.transmission import (
    gear_ratio,
    gravity_parameters,
    gravity_torque,
    kinematic_error_parameters,
    spring_parameters,
    spring_torque,
    transmission_ratio,
)


@dataclass(frozen=True)
class Electromechanical(Model):
    """Model 3: states current, positions and velocities; inputs voltage and external torque.

    Nominal values are the truth column of Table III. The paper does not give some values, which are our choice: J_m and
    J_q from Table V, N = 101, no Coulomb friction at the link. c_b and c_m act on the same velocity, so only their sum
    can be identified; c_b is fixed at its bearing value unless it is freed. The cubic stiffness is a 2000th of that of
    Table V, which is from a real joint: the prior allows for both.
    """

    name = "electromechanical"
    summary = "motor, harmonic drive and link with the electrical circuit (paper Model 3)"

    friction: str = "coulomb_viscous"
    gravity: bool = False
    kinematic_error: bool = False

    @cached_property
    def _motor_friction(self) -> Friction:
        return motor_friction(self.friction, c_m=3.04e-2, tau_fm=4.464e-2)

    @cached_property
    def _link_friction(self) -> Friction:
        tau_fq = Parameter("tau_fq", "Nm", "Coulomb friction at the link", 0.0, lower=0.0, fixed=True)
        return link_friction(self.friction, c_q=4.031e1, tau_fq=tau_fq)

    @cached_property
    def states(self) -> tuple[Signal, ...]:
        names = ("current", "motor_position", "link_position", "motor_velocity", "link_velocity")
        return tuple(channel(n) for n in names)

    @cached_property
    def inputs(self) -> tuple[Signal, ...]:
        return (channel("voltage"), channel("external_torque"))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            *electrical_parameters(),
            positive("k_t", "Nm/A", "torque constant", 5.507e-2),
            Parameter("c_b", "Nm s/rad", "viscous friction of the bearing", 1.459e-4, lower=0.0, fixed=True),
            Parameter("J_m", "kg m^2", "inertia of rotor and wave generator", 6e-5, lower=0.0, fixed=True),
            *self._motor_friction.parameters,
            *spring_parameters(k_1=8.0e3, k_2=4.0e5, c_1=7.1, k_2_within=1e3),
            Parameter(
                "J_q", "kg m^2", "inertia of circular spline and load", 7.780e-1, lower=0.0, fixed=True, group="load"
            ),
            *self._link_friction.parameters,
            gear_ratio(),
            *(kinematic_error_parameters() if self.kinematic_error else ()),
            *(gravity_parameters() if self.gravity else ()),
        )

    def derivative(self, x: Sequence[Any], u: Sequence[Any], p: Any, ops: Ops) -> tuple[Any, ...]:
        i, theta_m, q, w_m, w_q = x
        v_s, tau_ext = u
        di = (v_s - p.R * i - p.k_b * w_m) / p.L
        tau_spring = spring_torque(theta_m / p.N - q, w_m / p.N - w_q, p)
        i_hd = transmission_ratio(theta_m, p, ops, self.kinematic_error)
        friction = p.c_b * w_m + self._motor_friction.torque(w_m, p, ops)
        dw_m = (p.k_t * i - friction - i_hd * tau_spring) / p.J_m
        load = self._link_friction.torque(w_q, p, ops) + tau_ext
        if self.gravity:
            load = load + gravity_torque(q, p, ops)
        return (di, w_m, w_q, dw_m, (tau_spring - load) / p.J_q)
