"""The result of a fit of a whole arm, as a table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from joint_id_core.arm.payload import Factor, Payload
from joint_id_core.results.at_link import AtLink
from joint_id_core.results.status import Status
from joint_id_core.results.verdict import Verdict

FORMAT, VERSION = "joint_id arm estimate", 1


@dataclass(frozen=True)
class Value:
    """A quantity of a joint at the link, with its standard deviation, its verdict and what there is to say of it."""

    value: float
    std_dev: float
    unit: str
    verdict: Verdict
    reason: str

    def beside(self, told: str) -> Value:
        """Return the same with one more thing to say."""
        return replace(self, reason="; ".join(filter(None, (self.reason, told))))

    def __str__(self) -> str:
        """Return it as text: "12.3 ± 0.4", or what is known instead."""
        if self.verdict is Verdict.ESTIMATED:
            return f"{self.value:.4g} ± {self.std_dev:.2g}"
        if self.verdict is Verdict.PRIOR:
            return f"< {self.value + 2.0 * self.std_dev:.2g}"
        return "-" if self.verdict is Verdict.NOT_EXCITED else "0 (bound)"


@dataclass(frozen=True)
class JointValues:
    """What is known of one joint.

    Attributes:
        name: of the joint.
        armature: inertia of the rotor seen at the link.
        damping, friction: viscous and Coulomb friction.
        r_squared, held_out: share of the torque that is explained, below 8 Hz and in motion: of the recordings that
            were fitted, and of another one (NaN without).
    """

    name: str
    armature: Value
    damping: Value
    friction: Value
    r_squared: float
    held_out: float

    def at_link(self) -> list[AtLink]:
        """Return what is estimated, for a robot's description."""
        found = []
        for name in ("damping", "friction", "armature"):
            value: Value = getattr(self, name)
            if value.verdict is Verdict.ESTIMATED:
                told = "whole arm" + (f", {value.reason}" if value.reason else "")
                found.append(AtLink(name, value.value, value.std_dev, value.unit, told))
        return found


@dataclass(frozen=True)
class BaseParameter:
    """A combination of inertial parameters that motion can show: value, standard deviation, what the description says.

    `text` is the combination, in kg, kg m and kg m^2.
    """

    text: str
    value: float
    std_dev: float
    described: float
    verdict: Verdict


@dataclass(frozen=True)
class ArmEstimate:
    """The result of `fit_arm`.

    Attributes:
        source: of the description.
        status: CONVERGED, or POOR_FIT if the torque of a joint is not explained.
        poor: names of such joints.
        joints, parameters: what was found.
        duration: of motion in s.
        payload: what the arm carries in some recordings; None if in none.
        factors: on the torques, from the mass of a payload that is known; empty without.
        doubts: what the checks of the recordings found.
    """

    source: str
    status: Status
    poor: Sequence[str]
    joints: tuple[JointValues, ...]
    parameters: tuple[BaseParameter, ...]
    duration: float
    payload: Payload | None = None
    factors: tuple[Factor, ...] = ()
    doubts: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the torques of all joints are explained."""
        return self.status is Status.CONVERGED

    @property
    def message(self) -> str:
        """What to make of it."""
        known = sum(p.verdict is Verdict.ESTIMATED for p in self.parameters)
        said = (
            f"{known} of {len(self.parameters)} combinations of masses and inertias are known to half of their value."
        )
        if self.converged:
            return f"Converged. {said}"
        return (
            f"The torque of {', '.join(self.poor)} is not explained: another load acts on it, the gains or the "
            f"description are wrong, or its drive is another quantity. {said}"
        )

    def __str__(self) -> str:
        """Return a table, a row a joint."""
        width = max(len("joint"), *(len(j.name) for j in self.joints)) + 2
        held_out = any(math.isfinite(j.held_out) for j in self.joints)
        head = f"  {'joint':<{width}}{'damping':<18}{'friction':<18}{'armature':<18}{'R^2':<9}"
        lines = [
            f"arm of {len(self.joints)} joints: {self.status.value}", f"  {self.message}", "",
            head + ("held out" if held_out else ""), f"  {'':<{width}}{'Nm s/rad':<18}{'Nm':<18}{'kg m^2':<18}",
        ]  # fmt: skip
        for j in self.joints:
            row = f"  {j.name:<{width}}{j.damping!s:<18}{j.friction!s:<18}{j.armature!s:<18}{j.r_squared:<9.4f}"
            lines.append(row + (f"{j.held_out:.4f}" if held_out else ""))
        told = [
            f"  {j.name}, {name}: {getattr(j, name).reason}"
            for j in self.joints
            for name in ("damping", "friction", "armature")
            if getattr(j, name).reason
        ]
        lines += ["", f"  {self.duration:.3g} s of motion; values at the link", *told]
        lines += [f"  {self.payload}"] if self.payload is not None else []
        if self.factors:
            listed = ", ".join(f"{f.joint} {f.value:.4g} ± {f.std_dev:.2g}" for f in self.factors)
            lines.append(f"  the torques are right if they are multiplied by: {listed}")
        return "\n".join([*lines, *(f"  doubtful: {text}" for text in self.doubts)])

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain JSON types; values that are not finite become None."""
        return {
            "format": FORMAT, "version": VERSION, "description": self.source, "status": self.status.value,
            "message": self.message, "duration_s": self.duration, "joints": [_plain(asdict(j)) for j in self.joints],
            "parameters": [_plain(asdict(p)) for p in self.parameters],
            "payload": None if self.payload is None else _plain(asdict(self.payload)),
            "factors": [_plain(asdict(f)) for f in self.factors], "doubts": list(self.doubts),
        }  # fmt: skip


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row as plain JSON types."""
    found: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, dict):
            value = _plain(value)
        elif isinstance(value, Verdict):
            value = value.value
        elif isinstance(value, float) and not math.isfinite(value):
            value = None
        found[name] = value
    return found
