"""What a joint may do: limits of position, velocity, acceleration, jerk and torque, and where a motion breaks them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.errors import JointIdError

# What is taken where no limit is given. Manufacturers publish no acceleration for UR robots; their own description has
# 5 rad/s^2 there (Universal_Robots_ROS2_Description, config/*/joint_limits.yaml).
ACCELERATION = 5.0  # rad/s^2
RISE_S = 0.1  # time in which an acceleration may go from nothing to its limit, which limits the jerk
KINDS = ("velocity", "acceleration", "jerk", "torque")
UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "torque": "Nm"}
# In rad or rad/s; limits of position and velocity are above it in degrees, and those of no joint of an arm are in rad.
OF_DEGREES = 30.0
PARTS = 8  # instants checked for each sample
ROUNDING = 1e-9  # share of a limit that is no violation

Torque = Callable[[Array, Array, Array], Array]  # of position, velocity, acceleration (n, joints) -> (n, joints)


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of joints, each of shape (joints,); infinite where there is none.

    Attributes:
        names: of the joints.
        lower, upper: of the position in rad (m for a joint that slides).
        velocity, acceleration, jerk: of the absolute value, in rad/s, rad/s^2, rad/s^3.
        torque: at the link, of the absolute value, in Nm.
        source: where they came from, for messages.

    Raises:
        JointIdError: limits that contradict: no room between lower and upper, a limit that is not above 0.
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    torque: Array
    source: str = "limits"

    def __post_init__(self) -> None:
        for kind in ("lower", "upper", *KINDS):
            values = np.broadcast_to(np.asarray(getattr(self, kind), dtype=float), (len(self.names),)).copy()
            object.__setattr__(self, kind, values)
            wrong = np.isnan(values) if kind in ("lower", "upper") else ~(values > 0.0)
            if wrong.any():
                k = int(np.argmax(wrong))
                raise JointIdError(
                    f"{self.source}: joint {self.names[k]} has the limit {kind} = {values[k]:g}: give a number"
                    + ("" if kind in ("lower", "upper") else " above 0")
                )
        if (closed := self.lower >= self.upper).any():
            k = int(np.argmax(closed))
            raise JointIdError(
                f"{self.source}: joint {self.names[k]} may go from {self.lower[k]:g} to {self.upper[k]:g} rad, which "
                "leaves no room: the lower limit must be below the upper one"
            )

    @classmethod
    def none(cls, names: Sequence[str], source: str = "limits") -> JointLimits:
        """Return limits of joints that have none."""
        free = np.full(len(names), math.inf)
        return cls(tuple(names), -free, free, free, free, free, free, source)

    def of(self, names: Sequence[str]) -> JointLimits:
        """Return the limits of these joints, in this order.

        Raises:
            JointIdError: one of them is not known.
        """
        if missing := [name for name in names if name not in self.names]:
            raise JointIdError(f"{self.source}: no limits of the joint {missing[0]}: it has {', '.join(self.names)}")
        k = [self.names.index(name) for name in names]
        parts = {kind: getattr(self, kind)[k] for kind in ("lower", "upper", *KINDS)}
        return replace(self, names=tuple(names), **parts)

    def completed(self) -> tuple[JointLimits, tuple[str, ...]]:
        """Return limits with which a motion can be designed, and sentences that say what was added.

        Where no acceleration is limited, `ACCELERATION` is taken; where no jerk is, what reaches the acceleration
        within `RISE_S`. A motion has no bounds without those of position and velocity: these must be given.

        Raises:
            JointIdError: a joint without limits of position or of velocity.
        """
        for kind in ("lower", "upper", "velocity"):
            if (free := ~np.isfinite(getattr(self, kind))).any():
                k = int(np.argmax(free))
                what = kind if kind == "velocity" else "position"
                raise JointIdError(
                    f"{self.source}: joint {self.names[k]} has no limit of {what}: give one in a file of limits "
                    f"(--limits FILE, with {'max_velocity' if what == 'velocity' else 'min_position and max_position'})"
                )
        notes = [
            f"{name} has the limit {kind} = {value:g} {UNITS[kind]}: if it is in degrees, write it in SI units, in a "
            f"YAML file as !degrees {value:g} ({self.source})."
            for kind, values in (("position", np.maximum(-self.lower, self.upper)), ("velocity", self.velocity))
            for name, value in zip(self.names, values, strict=True)
            if value > OF_DEGREES
        ]
        quick, sudden = ~np.isfinite(self.acceleration), ~np.isfinite(self.jerk)
        acceleration = np.where(quick, ACCELERATION, self.acceleration)
        jerk = np.where(sudden, acceleration / RISE_S, self.jerk)
        if quick.any():
            notes.append(
                f"No limit of acceleration is given for {self._named(quick)}: {ACCELERATION:g} rad/s^2 is taken."
            )
        if sudden.any():
            notes.append(
                f"No limit of jerk is given for {self._named(sudden)}: the acceleration may reach its limit in "
                f"{RISE_S:g} s."
            )
        if (weak := ~np.isfinite(self.torque)).any():
            notes.append(f"No limit of torque is given for {self._named(weak)}: none is held.")
        return replace(self, acceleration=acceleration, jerk=jerk), tuple(notes)

    def _named(self, which: Array) -> str:
        """Return the names of some joints, or that it is all of them."""
        found = [name for name, one in zip(self.names, which, strict=True) if one]
        return "any joint" if len(found) == len(self.names) > 1 else ", ".join(found)


def violations(trajectory: Trajectory, limits: JointLimits, torque: Torque | None = None) -> tuple[str, ...]:
    """Return where a trajectory breaks limits, between its samples, too: one sentence for each joint and kind.

    Args:
        trajectory: of some joints.
        limits: of these joints and perhaps more.
        torque: of the arm in Nm; without it no torque is checked.
    """
    own = limits.of(trajectory.names)
    state = trajectory.between(PARTS)
    time = np.linspace(0.0, trajectory.duration, len(state.position))
    found = []
    values = {kind: np.abs(getattr(state, kind)) for kind in ("velocity", "acceleration", "jerk")}
    if torque is not None:
        values["torque"] = np.abs(torque(state.position, state.velocity, state.acceleration))
    for j, name in enumerate(own.names):
        beyond = np.maximum(state.position[:, j] - own.upper[j], own.lower[j] - state.position[:, j])
        if beyond.max() > ROUNDING:
            k = int(np.argmax(beyond))
            found.append(
                f"{name}: position {state.position[k, j]:.6g} rad at {time[k]:.3f} s, limits {own.lower[j]:.6g} to "
                f"{own.upper[j]:.6g} rad"
            )
        for kind, size in values.items():
            k, limit = int(np.argmax(size[:, j])), float(getattr(own, kind)[j])
            if size[k, j] > limit * (1.0 + ROUNDING):
                unit = UNITS[kind]
                found.append(f"{name}: {kind} {size[k, j]:.6g} {unit} at {time[k]:.3f} s, limit {limit:.6g} {unit}")
    return tuple(found)
