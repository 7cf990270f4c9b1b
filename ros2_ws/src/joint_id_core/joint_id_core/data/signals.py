"""Quantities that can be measured (`Signal`) and constants that can be identified (`Parameter`).

Channel names are the same everywhere: CSV columns, message fields, model states and inputs. All units
are SI, but for temperatures in deg C; motor quantities are at the motor shaft, link quantities behind the gear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from joint_id_core.data.quantities import unit_text
from joint_id_core.errors import JointIdError

LARGEST = 1e9  # no signal of a joint is larger, in its SI unit: a larger value means damaged data


@dataclass(frozen=True)
class Signal:
    """A quantity that varies in time: a state, an input or a label.

    `hold` says how an input varies between two samples: "zero" (constant, as a controller sets it) or "first" (for a
    measured motion: linear, or bent if its rate is an input, too; see `models.base.Model.rates`). `scale` is a typical
    magnitude in `unit`, used as the standard deviation of an unknown start value.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    scale: float = 1.0
    hold: Literal["zero", "first"] = "zero"


@dataclass(frozen=True)
class Parameter:
    """A physical constant of a joint.

    `nominal` is the start value; NaN means that there is no sensible default and the user must give one.
    `lower >= 0` makes the parameter positive: its logarithm is then estimated. `spread` is the standard deviation of
    the prior: in natural logarithms for a positive parameter, in `unit` for the others. A `fixed` parameter is not
    estimated unless it is freed. Parameters of the same `group` change for the same cause: friction, gear, load. One
    `of_recording` may differ between recordings of the same joint, as offsets of sensors do.
    """

    name: str
    unit: str
    meaning: str
    nominal: float
    lower: float = -math.inf
    upper: float = math.inf
    spread: float = math.log(10.0)
    fixed: bool = False
    group: str = ""
    of_recording: bool = False

    @property
    def positive(self) -> bool:
        """Whether the parameter is positive, so that its logarithm is estimated."""
        return self.lower >= 0.0

    def allows(self, value: float) -> bool:
        """Return whether a value is within the bounds."""
        return self.lower <= value <= self.upper

    def checked(self, value: float) -> float:
        """Return `value` if it is finite and within the bounds.

        Raises:
            JointIdError: the value is not finite or out of bounds.
        """
        unit = unit_text(self.unit)
        if not math.isfinite(value):
            raise JointIdError(f"parameter {self.name} = {value}: must be a finite number{unit and f' in {unit}'}")
        if not self.allows(value):
            raise JointIdError(
                f"parameter {self.name} = {value:g}{unit and f' {unit}'} is outside its bounds "
                f"[{self.lower:g}, {self.upper:g}]: give a value within them"
            )
        return float(value)

    def with_nominal(self, value: float) -> Parameter:
        """Return a copy with another start value, checked against the bounds."""
        return replace(self, nominal=self.checked(value))


def positive(name: str, unit: str, meaning: str, nominal: float, **kwargs: float | bool | str) -> Parameter:
    """Build a parameter that cannot be negative (inertia, stiffness, damping, friction level)."""
    return Parameter(name, unit, meaning, nominal, lower=0.0, **kwargs)  # type: ignore[arg-type]  # kwargs are Parameter fields


CHANNELS: dict[str, Signal] = {
    s.name: s
    for s in (
        Signal("motor_position", "theta_m", "rad", "motor shaft angle", 10.0),
        Signal("motor_velocity", "dtheta_m", "rad/s", "motor shaft velocity", 100.0),
        Signal("motor_acceleration", "ddtheta_m", "rad/s^2", "motor shaft acceleration", 1e4),
        Signal("link_position", "q", "rad", "link angle behind the gear", 1.0),
        Signal("link_velocity", "dq", "rad/s", "link velocity", 1.0),
        Signal("link_acceleration", "ddq", "rad/s^2", "link acceleration", 100.0),
        Signal("current", "i", "A", "motor current", 10.0),
        Signal("voltage", "V_s", "V", "voltage at the motor terminals", 10.0),
        Signal("torque", "tau_m", "Nm", "motor torque at the motor shaft", 1.0),
        Signal("external_torque", "tau_ext", "Nm", "load torque, positive against positive motion", 10.0),
        Signal("drifting_load", "tau_d", "Nm", "torque on the link that nothing records, as external_torque", 10.0),
        Signal("load_rate", "dtau_d", "Nm/s", "how fast drifting_load changes", 100.0),
        Signal("reference_position", "q_r", "rad", "commanded link angle; an instrument of regression", 1.0),
        Signal(
            "target_current", "i_t", "A", "current that the controller's own model asks for; no model uses it", 10.0
        ),
        Signal("temperature", "T", "deg C", "temperature of the joint; no model uses it, estimates tell it", 10.0),
    )
}
BESIDE = ("target_current", "temperature")  # channels that say nothing of the motion: they are not checked


_KINDS = ("position", "velocity", "acceleration")  # each the time derivative of the one before
_SIDES = {"motor": "link", "link": "motor"}  # of the gear


def derivative_of(name: str) -> str | None:
    """Return the name of a channel's time derivative: "motor_velocity" for "motor_position". None if it has none."""
    return _beside(name, 1)


def integral_of(name: str) -> str | None:
    """Return the name of the channel whose time derivative this one is. None if there is none."""
    return _beside(name, -1)


def _beside(name: str, step: int) -> str | None:
    side, _, kind = name.rpartition("_")
    at = _KINDS.index(kind) + step if kind in _KINDS else -1
    return f"{side}_{_KINDS[at]}" if side and 0 <= at < len(_KINDS) else None


def side_of(name: str) -> str | None:
    """Return the side of the gear that a channel belongs to: "motor", "link" or None."""
    side = name.partition("_")[0]
    return side if side in _SIDES else None


def across_gear(name: str) -> str | None:
    """Return the same quantity on the other side of the gear: "link_position" for "motor_position". Else None."""
    side = side_of(name)
    return f"{_SIDES[side]}{name.removeprefix(side)}" if side else None


def channel(name: str, **changes: str) -> Signal:
    """Return the channel called `name`, with changed fields (e.g. `hold="first"`)."""
    return replace(CHANNELS[name], **changes)  # type: ignore[arg-type]  # only string fields are changed
