"""What is believed of an arm before a motion is designed: friction, rotors, noise, and how far the links may be off.

Typical values are those of a UR10e (docs/real_robots.md): there friction, rotors and noise of all six joints are about
the same share of the joint's greatest torque.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from joint_id_core.arm.arm_estimate import FORMAT
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array
from joint_id_core.design.limits import JointLimits
from joint_id_core.errors import JointIdError

# Shares of the greatest torque: Coulomb friction; damping, s/rad; inertia of the rotor at the link, s^2/rad; standard
# deviation of what a fit leaves of the torque below 8 Hz.
COULOMB, DAMPING, ROTOR, NOISE = 0.046, 0.056, 0.012, 0.003
GROWTH = 0.06  # of friction with the load, Nm/Nm
MEMORY_S = 0.1  # of the noise
WRONG = 0.2  # standard deviation of a mass in the description, as a share of it
DRAWS = 7  # arms beside that of the description for which torques must hold


@dataclass(frozen=True, eq=False)
class ArmPrior:
    """What is believed of n joints, at the link.

    Attributes:
        damping, coulomb, bend: of the friction of each joint in Nm s/rad and Nm, shape (n,); see `arm.friction`. A bend
            is NaN where nobody knows whether friction bends.
        rotor: inertia in kg m^2, shape (n,).
        growth: of Coulomb friction with the load, Nm/Nm.
        noise: standard deviation of what no law explains below 8 Hz, in Nm, shape (n,).
        memory: time in s after which the noise has forgotten itself, shape (n,).
        told: a sentence that says where this is from.
    """

    damping: Array
    coulomb: Array
    bend: Array
    rotor: Array
    growth: float
    noise: Array
    memory: Array
    told: str

    def values(self, regressor: Regressor) -> Array:
        """Return base parameters by the description and these rotors, then damping, Coulomb friction and its growth."""
        base = regressor.reference.copy()
        base[: len(self.rotor)] += self.rotor
        return np.concatenate([base, self.damping, self.coulomb, [self.growth]])

    def possible(self, regressor: Regressor) -> Array:
        """Return such values of arms whose links are off from the description, the first is not, shape (DRAWS + 1, P).

        Every link is heavier or lighter as a whole, by draws that are the same on every computer.
        """
        count = len(self.rotor)
        found = np.tile(self.values(regressor), (DRAWS + 1, 1))
        factors = np.exp(WRONG * np.random.default_rng(0).standard_normal((DRAWS, count)))
        for row, factor in zip(found[1:], factors, strict=True):
            bodies = (regressor.bodies * factor[:, None]).ravel()
            row[: len(regressor.reference)] = regressor.composition[:, count:] @ bodies
            row[:count] += self.rotor
        return found


def typical(regressor: Regressor, limits: JointLimits) -> ArmPrior:
    """Return typical values for joints of these limits.

    Raises:
        JointIdError: a joint has no limit of torque.
    """
    greatest = limits.of(regressor.joints).torque
    if (free := ~np.isfinite(greatest)).any():
        raise JointIdError(
            f"{limits.source}: joint {regressor.joints[int(np.argmax(free))]} has no limit of torque, which typical "
            "friction and noise are taken from: give max_effort in a file of limits (--limits), or a fit (--fit)"
        )
    told = (
        f"Typical friction and noise are taken: Coulomb friction {100 * COULOMB:.2g} % of the greatest torque, noise "
        f"below 8 Hz {100 * NOISE:.2g} % of it, as of a UR10e. With a fit of this arm (--fit) they are its own."
    )
    flat = np.ones(len(greatest))
    return ArmPrior(
        DAMPING * greatest,
        COULOMB * greatest,
        math.nan * flat,
        ROTOR * greatest,
        GROWTH,
        NOISE * greatest,
        MEMORY_S * flat,
        told,
    )


def of_fit(path: str | Path, joints: Sequence[str]) -> ArmPrior:
    """Return what a fit has found (`joint-id arm fit --save`).

    Raises:
        JointIdError: the file cannot be read, is no such fit, or is of other joints.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise JointIdError(
            f"{path}: cannot be read as JSON ({error}): save a fit with joint-id arm fit --save"
        ) from None
    return from_dict(content, joints, str(path))


def from_dict(content: Any, joints: Sequence[str], source: str) -> ArmPrior:
    """Return what a fit has found, from `ArmEstimate.to_dict`.

    Raises:
        JointIdError: it is no such fit, or of other joints.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise JointIdError(f"{source}: no fit of an arm: save one with joint-id arm fit --save")
    rows = {row["name"]: row for row in content["joints"]}
    if missing := [name for name in joints if name not in rows]:
        raise JointIdError(f"{source}: a fit of {', '.join(rows)}, not of {missing[0]}: take a fit of this arm")
    if any((rows[name].get("noise") or {}).get("std_dev") is None for name in joints):
        raise JointIdError(f"{source}: does not tell the noise of every joint: fit the arm again, from a motion of all")

    def column(*keys: str) -> Array:
        return np.array([_number(rows[name], keys) for name in joints])

    growth = content["friction_by_load"]
    return ArmPrior(
        column("damping", "value"),
        column("friction", "value"),
        column("bend"),
        column("armature", "value"),
        _number(growth, ("value",)) if growth["verdict"] == "estimated" else GROWTH,
        column("noise", "std_dev"),
        # what is left of a fast motion does not tell how slow the noise is
        np.maximum(column("noise", "memory"), MEMORY_S),
        f"Friction, rotors and noise are those of {source}.",
    )


def _number(row: Any, keys: Sequence[str]) -> float:
    """Return a number of a saved fit; 0 where it found none."""
    for key in keys:
        row = row[key]
    return 0.0 if row is None or not math.isfinite(row) else float(row)
