"""Parts that several models share: drive torque, harmonic-drive spring, gravity."""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

from joint_id_core.data.signals import Parameter, Signal, channel, positive
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.models.base import Ops

Actuation = Literal["torque", "current"]
DRIVES: tuple[str, ...] = get_args(Actuation)

GEAR_RATIO = 101.0  # UR robots; the paper does not give N, but its Fig. 4 agrees with this value


def drive_signal(actuation: Actuation) -> Signal:
    """Return the input that drives the motor: its torque or its current.

    Raises:
        JointIdError: it is neither.
    """
    if actuation not in DRIVES:
        raise JointIdError(
            f"unknown actuation {actuation!r}{close_to(actuation, DRIVES)}: choose one of {', '.join(DRIVES)}"
        )
    return channel(actuation)


def drive_parameters(actuation: Actuation) -> tuple[Parameter, ...]:
    """Return the torque constant if the input is a current. It scales all other parameters, so it has no default."""
    if actuation == "torque":
        return ()
    return (Parameter("k_t", "Nm/A", "torque constant of the motor", math.nan, lower=1e-9, upper=1e6, fixed=True),)


def drive_torque(actuation: Actuation, u: Any, p: Any) -> Any:
    """Return the torque at the motor shaft in Nm."""
    return u if actuation == "torque" else p.k_t * u


def gear_ratio(nominal: float = GEAR_RATIO) -> Parameter:
    """Return the parameter N, the gear reduction ratio (paper Eq 7), a known constant."""
    return Parameter("N", "1", "gear reduction ratio", nominal, lower=1e-6, upper=1e5, fixed=True)


def spring_parameters(k_1: float, k_2: float, c_1: float, k_2_within: float = 10.0) -> tuple[Parameter, ...]:
    """Return damping, linear and cubic stiffness of the harmonic drive (paper Eqs 9 and 10).

    The prior of the cubic one has a standard deviation of a factor `k_2_within`.
    """
    spread = math.log(k_2_within)
    return (
        positive("c_1", "Nm s/rad", "damping of the harmonic drive", c_1, group="gear"),
        positive("k_1", "Nm/rad", "linear stiffness of the harmonic drive", k_1, group="gear"),
        positive("k_2", "Nm/rad^3", "cubic stiffness of the harmonic drive", k_2, spread=spread, group="gear"),
    )


def spring_torque(twist: Any, twist_rate: Any, p: Any) -> Any:
    """Return the torque in Nm that the flexspline transmits to the link (paper Eq 10)."""
    return p.c_1 * twist_rate + p.k_1 * twist + p.k_2 * twist * twist * twist


def balanced_twist(torque: float, velocity: float, acceleration: float, p: Any) -> float:
    """Return the twist in rad at which the spring balances a motor torque in Nm minus motor friction and inertia."""
    torque -= p.c_m * velocity + p.tau_fm * math.tanh(velocity)
    torque -= p.J_m * acceleration
    load = abs(p.N * torque)
    # Spring torque minus load is increasing and convex: Newton's method goes down to the root from an upper bound.
    twist = load / max(p.k_1, 1e-12)
    if p.k_2 > 0.0:
        twist = min(twist, (load / p.k_2) ** (1 / 3))
    for _ in range(20):
        twist -= (p.k_1 * twist + p.k_2 * twist**3 - load) / max(p.k_1 + 3.0 * p.k_2 * twist * twist, 1e-12)
    return math.copysign(twist, torque)


def kinematic_error_parameters() -> tuple[Parameter, ...]:
    """Return the parameters of the kinematic error a_ke sin(2 theta_m + phi_ke), in rad at the link, two per turn."""
    return (
        Parameter("a_ke", "rad", "amplitude of the kinematic error", 1e-4, -1e-2, 1e-2, spread=5e-4),
        Parameter("phi_ke", "rad", "phase of the kinematic error", 0.0, -2 * math.pi, 2 * math.pi, spread=2.0),
    )


def transmission_ratio(theta_m: Any, p: Any, ops: Ops, kinematic_error: bool) -> Any:
    """Return i_HD = 1/N + d(theta_ke)/d(theta_m) (paper Eq 8)."""
    if not kinematic_error:
        return 1.0 / p.N
    return 1.0 / p.N + 2.0 * p.a_ke * ops.cos(2.0 * theta_m + p.phi_ke)


def delay_parameters() -> tuple[Parameter, ...]:
    """Return the delays of the sensors; they may be negative. Real robots show 2 to 3 ms between their encoders."""
    return (
        Parameter("delta_p", "s", "delay of the encoders against the drive signal", 0.0, -0.02, 0.02, spread=0.005),
        Parameter("delta_q", "s", "delay of the link encoder against the motor's", 0.0, -0.02, 0.02, spread=0.005),
    )


LABEL_DELAYS = {
    "motor_position": ("delta_p",),
    "motor_velocity": ("delta_p",),
    "link_position": ("delta_p", "delta_q"),
    "link_velocity": ("delta_p", "delta_q"),
}


def offset_parameters() -> tuple[Parameter, ...]:
    """Return the constant offsets: of the drive's torque, and of the twist between the encoders."""
    return (
        Parameter("tau_0", "Nm", "torque offset at the motor", 0.0, -10.0, 10.0, spread=0.05, of_recording=True),
        Parameter(
            "dtheta_0", "rad", "twist offset between the encoders", 0.0, -7.0, 7.0, spread=0.01, of_recording=True
        ),
    )


def gravity_parameters() -> tuple[Parameter, ...]:
    """Return the parameters of the gravity torque a_g cos(q) + b_g sin(q), for an axis that is not vertical."""
    return (
        Parameter("a_g", "Nm", "gravity torque times cos(q)", 0.0, -1e4, 1e4, spread=50.0, group="load"),
        Parameter("b_g", "Nm", "gravity torque times sin(q)", 0.0, -1e4, 1e4, spread=50.0, group="load"),
    )


def gravity_torque(q: Any, p: Any, ops: Ops) -> Any:
    """Return the gravity torque in Nm, positive against positive motion."""
    return p.a_g * ops.cos(q) + p.b_g * ops.sin(q)
