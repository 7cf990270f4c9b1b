"""The result of a fit of a whole arm, as a table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from joint_id_core.arm.links import Links
from joint_id_core.arm.noise import Noise
from joint_id_core.arm.payload import Factor, Payload
from joint_id_core.arm.rests import LEAST_S
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
class Rest:
    """What is known of a joint that rests, or turns: its torque is that of the links and an offset, ± a band.

    Attributes:
        band: half of its width in Nm at the load of the joint's Coulomb friction; 0 if the joint never moved.
        recorded: time of rest in s in the fitted recordings; below `rests.LEAST_S` the band is friction at standstill.
        held, resting: of the held-out recording, the share of the rests that the band holds, and of the time in which
            the joint rests (NaN without).
    """

    band: float
    recorded: float
    held: float
    resting: float

    def __str__(self) -> str:
        """Return the band as text."""
        return f"± {self.band:.3g}" if self.band > 0.0 else "-"

    @property
    def scored(self) -> str:
        """What became of the held-out rests, as text."""
        if not math.isfinite(self.held):
            return "-"
        return f"{100.0 * self.held:.1f} % of {100.0 * self.resting:.0f} % of the time"


@dataclass(frozen=True)
class JointValues:
    """What is known of one joint.

    Attributes:
        name: of the joint.
        armature: inertia of the rotor seen at the link.
        damping, friction: viscous and Coulomb friction: the straight line that is nearest to friction up to 1 rad/s.
        r_squared, held_out: share of the torque that is explained, below 8 Hz and in motion: of the recordings that
            were fitted, and of another one (NaN without).
        load: torque through the gear in Nm at which `friction` is told.
        bend: of friction beside the straight line, in Nm: see `friction.bend`; 0 where none was found.
        rest: what is known at rest.
        noise: of its torque, which no law explains.
    """

    name: str
    armature: Value
    damping: Value
    friction: Value
    r_squared: float
    held_out: float
    load: float
    bend: float
    rest: Rest
    noise: Noise

    @property
    def pulled_below_zero(self) -> bool:
        """Whether the data ask for friction below zero of both kinds, which no joint has."""
        return self.damping.verdict is self.friction.verdict is Verdict.AT_BOUND

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
        status: CONVERGED, or POOR_FIT if the torque of a joint that moves is not explained, or not predicted.
        poor: names of such joints.
        joints, parameters: what was found.
        links: bodies that exist and have these parameters, near those of the description.
        duration: of motion in s.
        by_load: how much Coulomb friction grows with the load, Nm by Nm, the same of all joints.
        payload: what the arm carries in some recordings; None if in none.
        factors: on the torques, from the mass of a payload that is known; empty without.
        doubts: what the checks of the recordings found.
        recordings: that were fitted.
        missed: names of joints whose torque in the held-out recording is not predicted.
        contradiction: what the torques say that cannot be, in words; empty if nothing is.
        mistaken: how the arm seems to have been recorded, in words, if not as it moves: see `recorded_otherwise`.
    """

    source: str
    status: Status
    poor: Sequence[str]
    joints: tuple[JointValues, ...]
    parameters: tuple[BaseParameter, ...]
    links: Links
    duration: float
    by_load: Value
    payload: Payload | None = None
    factors: tuple[Factor, ...] = ()
    doubts: tuple[str, ...] = ()
    recordings: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()
    contradiction: str = ""
    mistaken: str = ""

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
        if still := [j.name for j in self.joints if math.isnan(j.r_squared)]:
            said = f"{', '.join(still)} did not move: nothing is known of {'it' if len(still) == 1 else 'them'}. {said}"
        if self.converged:
            return f"Converged. {said}"
        if self.mistaken:
            return f"The torques of all joints are explained far better otherwise: {self.mistaken}. {said}"
        if not self.poor and not self.missed:
            return f"The torques contradict the description: {self.contradiction}. {said}"
        if not self.poor:
            return (
                f"The torque of {', '.join(self.missed)} in the held-out recording is not predicted: something changed "
                "between the recordings (a load, the zero of a joint, the temperature), or the fitted ones show too "
                f"little. {said}"
            )
        if pulled := [j.name for j in self.joints if j.pulled_below_zero]:
            said = (
                f"Friction of {', '.join(pulled)} is pulled below zero, as of a drive that is recorded with the other "
                f"sign: check that first, it spoils the others. {said}"
            )
        return (
            f"The torque of {', '.join(self.poor)} is not explained: another load acts on it, the gains or the "
            f"description are wrong, or its drive is another quantity. {said}"
        )

    def at_link(self) -> dict[str, list[AtLink]]:
        """Return by joint what is estimated, for a file with the bodies of `links`: rotors are those beside them."""
        known = {j.name: j.at_link() for j in self.joints}
        for link in self.links.links:
            known[link.joint] = [
                replace(q, value=link.rotor, formula=q.formula.replace("in the description", "in this file"))
                if q.name == "armature"
                else q
                for q in known[link.joint]
            ]
        return known

    def __str__(self) -> str:
        """Return a table, a row a joint."""
        width = max(len("joint"), *(len(j.name) for j in self.joints)) + 2
        held_out = any(math.isfinite(j.held_out) or math.isfinite(j.rest.held) for j in self.joints)
        lines = [
            f"arm of {len(self.joints)} joints: {self.status.value}", f"  {self.message}", "",
            f"  {'joint':<{width}}{'damping':<17}{'friction':<17}{'armature':<17}{'at rest':<10}{'R^2':<9}"
            + ("held out  rests in band" if held_out else ""),
            f"  {'':<{width}}{'Nm s/rad':<17}{'Nm':<17}{'kg m^2':<17}Nm",
        ]  # fmt: skip
        for j in self.joints:
            row = f"  {j.name:<{width}}{j.damping!s:<17}{j.friction!s:<17}{j.armature!s:<17}{j.rest!s:<10}"
            row += f"{j.r_squared:<9.4f}"
            lines.append(row + (f"{j.held_out:<10.4f}{j.rest.scored}" if held_out else ""))
        told = [
            f"  {j.name}, {name}: {getattr(j, name).reason}"
            for j in self.joints
            for name in ("damping", "friction", "armature")
            if getattr(j, name).reason
        ]
        lines += ["", f"  {self.duration:.3g} s of motion; values at the link", *told]
        loads = ", ".join(f"{j.load:.3g}" for j in self.joints)
        if self.by_load.verdict is not Verdict.NOT_EXCITED:
            lines.append(f"  friction grows with the load, by {self.by_load} of it; here it is that at {loads} Nm")
        short = ", ".join(j.name for j in self.joints if not j.rest.recorded >= LEAST_S)
        if short:
            lines.append(f"  torque at rest is that of friction at standstill, no rest was recorded of {short}")
        lines += [f"  {self.payload}"] if self.payload is not None else []
        if self.factors:
            listed = ", ".join(map(str, self.factors))
            lines.append(f"  the torques are right if they are multiplied by: {listed}")
        lines += ["", *self.links.lines]
        return "\n".join([*lines, *(f"  doubtful: {text}" for text in (*self.doubts, *self.links.doubts))])

    @property
    def combinations(self) -> str:
        """The base parameters as a table: value, that of the description, verdict, and what each stands for."""
        lines = [f"  {'value':<24}{'description':<14}{'verdict':<13}combination, in kg, kg m and kg m^2"]
        for p in self.parameters:
            known = p.verdict is not Verdict.NOT_EXCITED
            value = f"{p.value:.4g} ± {p.std_dev:.2g}" if known else "-"
            lines.append(f"  {value:<24}{p.described:<14.4g}{p.verdict.value:<13}{p.text}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain JSON types; values that are not finite become None."""
        return {
            "format": FORMAT, "version": VERSION, "description": self.source, "status": self.status.value,
            "message": self.message, "recordings": [*self.recordings],
            "duration_s": self.duration, "friction_by_load": _plain(asdict(self.by_load)),
            "joints": [_plain(asdict(j)) for j in self.joints],
            "parameters": [_plain(asdict(p)) for p in self.parameters],
            "links": [asdict(link) for link in self.links.links], "description_wrong_by": self.links.share,
            "links_off": {"rms": self.links.off, "most": self.links.farthest},
            "payload": None if self.payload is None else _plain(asdict(self.payload)),
            "factors": [_plain(asdict(f)) for f in self.factors], "doubts": [*self.doubts, *self.links.doubts],
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
