"""The motor half of Model 2, with the measured link motion as an input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from joint_id_core.data.signals import Parameter, Signal, channel, positive
from joint_id_core.models.base import Model, Ops
from joint_id_core.models.friction import Friction
from joint_id_core.models.harmonic_drive import motor_friction
from joint_id_core.models.transmission import (
    LABEL_DELAYS,
    Actuation,
    balanced_twist,
    delay_parameters,
    drive_parameters,
    drive_signal,
    drive_torque,
    gear_ratio,
    kinematic_error_parameters,
    offset_parameters,
    spring_parameters,
    spring_torque,
    transmission_ratio,
)

# This model is mainly for joints that are held still. Near standstill their friction shows presliding and not a step.
SMOOTHING = 0.1  # rad/s at the motor shaft


@dataclass(frozen=True)
class MotorSide(Model):
    """Paper Eq 9 alone: states motor position and velocity, inputs drive, link position and velocity.

    The rest of the arm acts on the motor only through the measured link motion. So the model is valid while all joints
    move. tau_0 is a torque offset, and dtheta_0 is the twist at which the two encoders agree. It is fixed at zero
    unless it is freed, because the start value of an unmeasured motor position contains it. The cubic stiffness is
    estimated: a gear stiffens with its load, and a moving joint loads it. With k_2 fixed at zero, k_1 is the stiffness
    at the working point, which is enough for a joint that is held still.
    """

    name = "motor_side"
    summary = "motor half of the flexible joint, the measured link motion as input"

    actuation: Actuation = "torque"
    friction: str = "coulomb_viscous"
    kinematic_error: bool = False
    delays: bool = False

    @cached_property
    def _friction(self) -> Friction:
        return motor_friction(self.friction, c_m=1.018e-4, tau_fm=2.291e-2, w_s=SMOOTHING)

    @cached_property
    def states(self) -> tuple[Signal, ...]:
        return (channel("motor_position"), channel("motor_velocity"))

    @cached_property
    def inputs(self) -> tuple[Signal, ...]:
        names = ("link_position", "link_velocity", *(("link_acceleration",) if self.delays else ()))
        return (drive_signal(self.actuation), *(channel(name, hold="first") for name in names))

    @property
    def label_delays(self) -> dict[str, tuple[str, ...]]:
        return {s.name: LABEL_DELAYS[s.name] for s in self.states} if self.delays else {}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        tau_0, dtheta_0 = offset_parameters()
        return (
            positive("J_m", "kg m^2", "inertia of rotor and wave generator", 6e-5),
            *self._friction.parameters,
            *spring_parameters(k_1=5.164e3, k_2=9.021e8, c_1=18.938),
            tau_0,
            replace(dtheta_0, fixed=True),
            gear_ratio(),
            *drive_parameters(self.actuation),
            *(kinematic_error_parameters() if self.kinematic_error else ()),
            *(delay_parameters() if self.delays else ()),
        )

    def twist_under(self, drive: float, velocity: float, acceleration: float, p: Any) -> float:
        return balanced_twist(drive_torque(self.actuation, drive, p) - p.tau_0, velocity, acceleration, p)

    def derivative(self, x: Sequence[Any], u: Sequence[Any], p: Any, ops: Ops) -> tuple[Any, ...]:
        theta_m, w_m = x
        drive, q, w_q, *rest = u
        if self.delays:
            # The link encoder is late: extrapolate its signal by this delay to the present link motion.
            late, (a_q,) = p.delta_p + p.delta_q, rest
            q, w_q = q + late * (w_q + 0.5 * late * a_q), w_q + late * a_q
        tau_spring = spring_torque(theta_m / p.N - q - p.dtheta_0, w_m / p.N - w_q, p)
        i_hd = transmission_ratio(theta_m, p, ops, self.kinematic_error)
        tau_m = drive_torque(self.actuation, drive, p)
        dw_m = (tau_m - self._friction.torque(w_m, p, ops) - p.tau_0 - i_hd * tau_spring) / p.J_m
        return (w_m, dw_m)
