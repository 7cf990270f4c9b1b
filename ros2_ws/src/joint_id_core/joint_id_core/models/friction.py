"""Friction laws that a model can be built with.

Every law is Coulomb friction times the direction of sliding plus a viscous part. The direction comes from
`Ops.direction`: in estimation tanh(w / w_s) with a fixed, reported w_s, in simulation exact stick and slip. For the
laws and their names see Armstrong-Helouvry, Dupont, Canudas de Wit (1994).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from joint_id_core.data.signals import Parameter, positive
from joint_id_core.errors import JointIdError, close_to
from joint_id_core.models.base import Ops

LAWS = ("coulomb_viscous", "stribeck", "eyring")


@dataclass(frozen=True)
class Friction:
    """Friction torque on one velocity state.

    `law` is one of `LAWS`:

    - coulomb_viscous: tau_f dir(w) + c w (the paper's);
    - stribeck: (tau_f + (tau_s - tau_f) exp(-(w/w_b)^2)) dir(w) + c w, with tau_s = tau_f + dtau_s;
    - eyring: tau_f dir(w) + c w_e asinh(w/w_e), viscous slope c at rest that falls with speed
      (Ree-Eyring shear thinning), as measured on cobot joints.

    `side` is appended to the names of the parameters that the paper does not name.
    """

    velocity: str
    viscous: Parameter
    coulomb: Parameter
    side: str
    w_s: float
    w_typical: float
    law: str = "coulomb_viscous"

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise JointIdError(
                f"unknown friction law {self.law!r}{close_to(self.law, LAWS)}: choose one of {', '.join(LAWS)}"
            )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Viscous and Coulomb friction, the further parameters of the law, and the smoothing velocity (fixed)."""
        s, w = self.side, self.w_typical
        extra: tuple[Parameter, ...] = ()
        if self.law == "stribeck":
            extra = (
                positive(f"dtau_s{s}", "Nm", "static friction above the Coulomb level", 0.3 * self.coulomb.nominal),
                positive(f"w_b{s}", "rad/s", "Stribeck velocity", 0.05 * w, spread=1.0),
            )
        elif self.law == "eyring":
            extra = (positive(f"w_e{s}", "rad/s", "velocity at which the viscous slope falls", 0.5 * w, spread=1.0),)
        smoothing = Parameter(
            f"w_s{s}", "rad/s", "velocity that smooths the Coulomb step in estimation", self.w_s,
            lower=1e-9, fixed=True,
        )  # fmt: skip
        return tuple(replace(p, group="friction") for p in (self.viscous, self.coulomb, *extra, smoothing))

    def torque(self, w: Any, p: Any, ops: Ops) -> Any:
        """Return the friction torque in Nm at velocity `w` in rad/s, positive against positive motion."""
        s = self.side
        c, tau_f = getattr(p, self.viscous.name), getattr(p, self.coulomb.name)
        direction = ops.direction(self.velocity, w, getattr(p, f"w_s{s}"))
        if self.law == "stribeck":
            ratio = w / getattr(p, f"w_b{s}")
            return (tau_f + getattr(p, f"dtau_s{s}") * ops.exp(-ratio * ratio)) * direction + c * w
        if self.law == "eyring":
            w_e = getattr(p, f"w_e{s}")
            return tau_f * direction + c * w_e * ops.asinh(w / w_e)
        return tau_f * direction + c * w
