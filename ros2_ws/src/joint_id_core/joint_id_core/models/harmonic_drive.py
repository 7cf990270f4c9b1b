"""Model 2 of the paper: motor inertia, harmonic drive and link (Eqs 7 to 11)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from joint_id_core.data.signals import Parameter, Signal, channel, positive
from joint_id_core.errors import JointIdError
from joint_id_core.models.base import Model, Ops
from joint_id_core.models.friction import Friction
from joint_id_core.models.transmission import (
    LABEL_DELAYS,
    Actuation,
    balanced_twist,
    delay_parameters,
    drive_parameters,
    drive_signal,
    drive_torque,
    gear_ratio,
    gravity_parameters,
    gravity_torque,
    kinematic_error_parameters,
    offset_parameters,
    spring_parameters,
    spring_torque,
    transmission_ratio,
)

# Smoothing velocities, tested on a position-controlled joint with exact stick and slip (torque noise 0.003 Nm, two
# seconds). 1 rad/s at the motor leaves autocorrelated residuals (0.6 at lag one) and shifts k_1 by 2 %. With 0.1 rad/s,
# and 0.001 rad/s at the link, residuals are white and the bias of c_1 is 0.9 of its standard deviation. With a third of
# these velocities the bias is 0.6 of it.
MOTOR_SMOOTHING = 0.03  # rad/s at the motor shaft
LINK_SMOOTHING = 3e-4  # rad/s


def motor_friction(law: str, c_m: float, tau_fm: float, w_s: float = MOTOR_SMOOTHING) -> Friction:
    """Return the friction on the motor side (paper Eq 9)."""
    return Friction(
        "motor_velocity",
        positive("c_m", "Nm s/rad", "viscous friction at the motor", c_m),
        positive("tau_fm", "Nm", "Coulomb friction at the motor", tau_fm),
        side="m", w_s=w_s, w_typical=100.0, law=law,
    )  # fmt: skip


def link_friction(law: str, c_q: float, tau_fq: Parameter) -> Friction:
    """Return the friction on the link side (paper Eq 10)."""
    return Friction(
        "link_velocity",
        positive("c_q", "Nm s/rad", "viscous friction at the link", c_q),
        tau_fq,
        side="q", w_s=LINK_SMOOTHING, w_typical=1.0, law=law,
    )  # fmt: skip


@dataclass(frozen=True)
class HarmonicDrive(Model):
    """Model 2: states motor and link position and velocity, inputs motor and external torque.

    Valid while only this joint moves. With `drifting_load` it is valid whatever moves the link: one more torque on it,
    a random walk (an augmented disturbance state), stands for the rest of the arm, for a hand, and for gravity. Nominal
    values are the H-PINN column of Table V.

    Raises:
        JointIdError: both `gravity` and `drifting_load`.
    """

    name = "harmonic_drive"
    summary = "flexible joint: motor, harmonic drive, link (paper Model 2)"

    actuation: Actuation = "torque"
    friction: str = "coulomb_viscous"
    gravity: bool = False
    kinematic_error: bool = False
    delays: bool = False
    offsets: bool = False
    drifting_load: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gravity and self.drifting_load:  # gravity came out up to six standard deviations off
            raise JointIdError(
                f"model {self.name}: a load that drifts takes gravity as well: give gravity or drifting_load, not both"
            )

    @cached_property
    def _motor_friction(self) -> Friction:
        return motor_friction(self.friction, c_m=1.018e-4, tau_fm=2.291e-2)

    @cached_property
    def _link_friction(self) -> Friction:
        tau_fq = positive("tau_fq", "Nm", "Coulomb friction at the link", 2.296)
        return link_friction(self.friction, c_q=1.799, tau_fq=tau_fq)

    @cached_property
    def states(self) -> tuple[Signal, ...]:
        motion = ("motor_position", "link_position", "motor_velocity", "link_velocity")
        return tuple(channel(n) for n in (*motion, *(("drifting_load",) if self.drifting_load else ())))

    @cached_property
    def inputs(self) -> tuple[Signal, ...]:
        loads = ("external_torque", *(("load_rate",) if self.drifting_load else ()))
        return (drive_signal(self.actuation), *(channel(n) for n in loads))

    @property
    def optional_inputs(self) -> frozenset[str]:
        return super().optional_inputs | {"load_rate"}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            positive("J_m", "kg m^2", "inertia of rotor and wave generator", 6e-5),
            *self._motor_friction.parameters,
            *spring_parameters(k_1=5.164e3, k_2=9.021e8, c_1=18.938),
            positive("J_q", "kg m^2", "inertia of circular spline and load", 7.780e-1, group="load"),
            *self._link_friction.parameters,
            gear_ratio(),
            *drive_parameters(self.actuation),
            *(kinematic_error_parameters() if self.kinematic_error else ()),
            *(gravity_parameters() if self.gravity else ()),
            *(offset_parameters() if self.offsets else ()),
            *(delay_parameters() if self.delays else ()),
        )

    @property
    def label_delays(self) -> dict[str, tuple[str, ...]]:
        return LABEL_DELAYS if self.delays else {}

    def twist_under(self, drive: float, velocity: float, acceleration: float, p: Any) -> float:
        torque = drive_torque(self.actuation, drive, p) - (p.tau_0 if self.offsets else 0.0)
        return balanced_twist(torque, velocity, acceleration, p)

    def derivative(self, x: Sequence[Any], u: Sequence[Any], p: Any, ops: Ops) -> tuple[Any, ...]:
        theta_m, q, w_m, w_q, *drifting = x
        drive, tau_ext, *rate = u
        twist = theta_m / p.N - q - (p.dtheta_0 if self.offsets else 0.0)
        tau_spring = spring_torque(twist, w_m / p.N - w_q, p)
        i_hd = transmission_ratio(theta_m, p, ops, self.kinematic_error)
        tau_m = drive_torque(self.actuation, drive, p) - (p.tau_0 if self.offsets else 0.0)
        dw_m = (tau_m - self._motor_friction.torque(w_m, p, ops) - i_hd * tau_spring) / p.J_m
        load = self._link_friction.torque(w_q, p, ops) + tau_ext
        if self.gravity:
            load = load + gravity_torque(q, p, ops)
        if drifting:
            load = load + drifting[0]
        return (w_m, w_q, dw_m, (tau_spring - load) / p.J_q, *rate)
