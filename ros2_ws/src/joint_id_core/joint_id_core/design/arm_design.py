"""The design of a motion for a whole arm, and what `joint-id arm fit` will tell of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.arm_estimate import Value
from joint_id_core.arm.description import Description
from joint_id_core.arm.judged import base_parameters, friction, rotor
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array
from joint_id_core.design.arm_information import RIDGE, ArmColumns, Chosen
from joint_id_core.design.arm_motion import Task, found_motion
from joint_id_core.design.arm_prior import DRAWS, WRONG, ArmPrior, typical
from joint_id_core.design.arm_promise import Promise, promise
from joint_id_core.design.arm_waypoints import motion_through
from joint_id_core.design.criterion import require_criterion
from joint_id_core.design.design import Design, Expected
from joint_id_core.design.floor import Floor
from joint_id_core.design.limits import JointLimits
from joint_id_core.design.trajectory import Trajectory
from joint_id_core.design.waypoints import Waypoints
from joint_id_core.errors import JointIdError
from joint_id_core.options import Progress
from joint_id_core.results.verdict import Verdict

KINDS = ("friction", "rotors", "links")
REACH = 1.0  # rad (or m), how far a joint may go from home where the user says nothing
STATES = 300  # at random, from which the sizes of the parameters are taken
LEAST_S = 5.0  # of a motion: an arm of six joints has more than fifty parameters
QUANTITIES = (("damping", "Nm s/rad"), ("friction", "Nm"), ("armature", "kg m^2"))


@dataclass(frozen=True, eq=False)
class ArmDesign(Design):
    """A motion of an arm and its promise. `print` shows it as `joint-id arm fit` shows what it finds.

    Attributes:
        condition: condition number of the regressor of the base parameters, which other tools make small.
        effect: by combination, the torque that it makes by the description over the noise, root mean square.
    """

    condition: float = float("nan")
    effect: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the promise as plain JSON types, without the samples of the motion."""
        return {**super().to_dict(), "condition_number": self.condition}

    def __str__(self) -> str:
        """Return the promise: a row for each joint, then the combinations of masses and inertias."""
        motion = self.trajectory
        joints = {name: [row for row in self.expected if row.joint == name] for name in motion.names}
        combinations = [row for row in self.expected if not row.joint]
        width = max(len("joint"), *map(len, joints)) + 2
        known = sum(row.verdict is Verdict.ESTIMATED for row in combinations)
        lines = [
            f"motion of {len(joints)} joints: {motion.duration:g} s, {motion.rate:g} samples a second",
            f"  A fit of it will know {known} of {len(combinations)} combinations of masses and inertias to half of "
            "their value, and of the joints:",
            "",
            f"  {'joint':<{width}}" + "".join(f"{name:<17}" for name, _ in QUANTITIES) + "from, to",
            f"  {'':<{width}}" + "".join(f"{unit:<17}" for _, unit in QUANTITIES) + "rad",
        ]
        for k, (name, rows) in enumerate(joints.items()):
            told = "".join(f"{_shown(row):<17}" for row in rows)
            q = motion.position[:, k]
            lines.append(f"  {name:<{width}}{told}{q.min():.2f}, {q.max():.2f}")
        lines += [f"  {_name(row)}: {row.reason}" for row in self.expected if row.joint and row.reason]
        head = f"  {'std dev':<11}{'description':<13}{'torque':<9}{'verdict':<13}combination, in kg, kg m and kg m^2"
        lines += ["", head]
        for row in combinations:
            deviation = f"± {row.std_dev:.2g}" if np.isfinite(row.std_dev) else "-"
            told = f"{self.effect.get(row.name, 0.0):.2g}"
            lines.append(f"  {deviation:<11}{row.value:<13.4g}{told:<9}{row.verdict.value:<13}{row.name}")
        lines.append("  torque: that the combination makes by the description, as a multiple of the noise")
        return "\n".join([*lines, "", *(f"  {note}" for note in self.notes)])


def design_arm(
    description: Description,
    limits: JointLimits,
    prior: ArmPrior | None = None,
    home: Sequence[float] | None = None,
    duration: float = 20.0,
    rate: float = 125.0,
    shown: Sequence[str] = KINDS,
    reach: float = REACH,
    floor: float | None = None,
    seed: int = 0,
    criterion: str = "sigma",
    waypoints: Waypoints | None = None,
    progress: Progress = lambda _: None,
) -> ArmDesign:
    """Design a motion that tells as much as possible of an arm.

    Args:
        description: of the robot.
        limits: of its joints.
        prior: what is believed of it; None takes typical values for its limits (`arm_prior.typical`).
        home: pose at the start and end in rad, in the order of the description's joints; without, the middle of the
            limits.
        duration, rate: in s, and samples a second of the trajectory.
        shown: of `KINDS`, what shall be known. All else is in the way, and told, too.
        reach: how far a joint may go from home, rad (m for a joint that slides).
        floor: height in m, over the origin of the base, which no joint goes below; None without.
        seed: of the motions from which the search begins.
        criterion: what is least: "sigma", the geometric mean of the standard deviations; "D", the volume of their
            ellipsoid; "A", the sum of the variances. For "A" the unit of each parameter is what makes, in motions at
            random within the limits, as much torque as the noise.
        waypoints: of all joints: the motion goes through them, from the first one and back to it, in place of a Fourier
            series; `home` and `reach` say nothing then.
        progress: called with a line of text from time to time.

    Raises:
        JointIdError: limits that are missing or contradict, a home or waypoints that they do not allow, an unknown kind
            or criterion, a motion that is too short; without a prior, a joint without a limit of torque.
    """
    require_criterion(criterion)
    regressor = Regressor(description)
    if unknown := [kind for kind in shown if kind not in KINDS]:
        raise JointIdError(f"{unknown[0]!r} is nothing that an arm can show: known are {', '.join(KINDS)}")
    if not duration >= LEAST_S:
        raise JointIdError(f"a motion of {duration:g} s is too short for a whole arm: give {LEAST_S:g} s or more")
    if not 0.0 < reach < np.inf:
        raise JointIdError(f"reach = {reach:g} rad: give a number above 0")
    full, notes = limits.of(regressor.joints).completed()
    if waypoints is None:
        at = _home(full, home)
        near = replace(full, lower=np.maximum(full.lower, at - reach), upper=np.minimum(full.upper, at + reach))
    else:
        waypoints = waypoints.of(regressor.joints)
        at, near = waypoints.points[0], full
    prior = prior or typical(regressor, limits)
    columns = ArmColumns(regressor, prior)
    task = Task(
        columns,
        Chosen(_mask(regressor, shown), criterion, _sizes(columns, near)),
        near,
        prior.possible(regressor),
        at,
        duration,
        rate,
        None if floor is None else Floor(description, floor),
    )
    motion, way = (
        (found_motion(task, seed), ()) if waypoints is None else motion_through(task, waypoints, seed, progress)
    )
    return foreseen(
        regressor, motion, prior, (*notes, *way, prior.told, *_cautions(np.isfinite(full.torque), floor))
    )  # fmt: skip


def _home(limits: JointLimits, home: Sequence[float] | None) -> Array:
    """Return the pose at the start and end in rad, (joints,): without one the middle of the limits."""
    at = (limits.lower + limits.upper) / 2.0 if home is None else np.asarray(home, dtype=float)
    if at.shape != (len(limits.names),) or not np.isfinite(at).all():
        raise JointIdError(f"home has {at.size} numbers: give one for each of {', '.join(limits.names)}")
    if (outside := (at <= limits.lower) | (at >= limits.upper)).any():
        k = int(np.argmax(outside))
        raise JointIdError(
            f"home of {limits.names[k]} is {at[k]:g} rad, its limits are {limits.lower[k]:g} to {limits.upper[k]:g} "
            "rad: choose a home within them (--home)"
        )
    return at


def foreseen(regressor: Regressor, motion: Trajectory, prior: ArmPrior, notes: Sequence[str] = ()) -> ArmDesign:
    """Return a motion of an arm with what a fit of it will tell, e.g. of a motion of your own.

    Raises:
        JointIdError: the motion does not tell where all joints are, or is too short for the number of parameters.
    """
    if missing := [name for name in regressor.joints if name not in motion.names]:
        raise JointIdError(
            f"this motion moves {', '.join(motion.names)} and does not tell where {', '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'}: give one with all joints of the arm, also those that stand"
        )
    found = promise(regressor, motion, prior)
    count, base = len(regressor.joints), len(regressor.reference)
    seen, rows = np.isfinite(found.std_dev), []
    for j, joint in enumerate(regressor.joints):
        of_joint = [
            friction(float(found.values[k]), float(found.std_dev[k]), unit, bool(seen[k]))
            for k, (_, unit) in zip((base + j, base + count + j), QUANTITIES, strict=False)
        ]
        of_joint.append(rotor(regressor, j, float(found.values[j]), float(found.std_dev[j]), bool(seen[j])))
        places = (base + j, base + count + j, j)
        for k, (name, unit), value in zip(places, QUANTITIES, of_joint, strict=True):
            rows.append(_expected(joint, name, unit, value, found, k))
    for k, one in enumerate(base_parameters(regressor, found.values, found.std_dev, seen)):
        reason = "" if one.verdict is Verdict.ESTIMATED else _hidden(found, k)
        rows.append(Expected("", one.text, "SI", one.described, one.std_dev, one.verdict, reason))
    if np.isnan(prior.bend).any():
        notes = (
            *notes,
            "Nobody knows whether friction bends: that is in the promise. If it does not, a fit knows damping "
            f"{found.bent[0]:.2g} times and Coulomb friction {found.bent[1]:.2g} times better.",
        )
    effect = dict(zip(regressor.combinations, found.effect.tolist(), strict=False))
    return ArmDesign(motion, tuple(rows), tuple(notes), found.condition, effect)


def _mask(regressor: Regressor, shown: Sequence[str]) -> NDArray[np.bool_]:
    """Return which parameters shall be shown: of `ArmColumns`."""
    count, base = len(regressor.joints), len(regressor.reference)
    parts = {"rotors": count, "links": base - count, "friction": 2 * count}
    return np.concatenate([*(np.full(size, kind in shown) for kind, size in parts.items()), [False]])


def _sizes(columns: ArmColumns, limits: JointLimits) -> Array:
    """Return what makes as much torque as the noise, of each parameter, in states at random within the limits (P,)."""
    rng = np.random.default_rng(0)
    shape = (STATES, len(limits.names))
    q = rng.uniform(limits.lower, limits.upper, shape)
    dq, ddq = (rng.uniform(-most, most, shape) for most in (limits.velocity, limits.acceleration))
    shown = np.diag(columns.information(columns.at(q, dq, ddq))[0]) / STATES
    return 1.0 / np.sqrt(np.maximum(shown, RIDGE * shown.max()))


def _expected(joint: str, name: str, unit: str, value: Value, found: Promise, k: int) -> Expected:
    reason = value.reason if value.verdict is Verdict.ESTIMATED else _hidden(found, k)
    return Expected(joint, name, unit, value.value, value.std_dev, value.verdict, reason)


def _hidden(found: Promise, k: int) -> str:
    """Return why a motion does not show a parameter."""
    if not np.isfinite(found.std_dev[k]):
        return "the motion does not depend on it"
    return f"± {found.std_dev[k]:.2g}; its torque is {found.effect[k]:.2g} of the noise"


def _cautions(strong: Array, floor: float | None) -> list[str]:
    """Return what was held and what the user must check."""
    torque = (
        f"Torques keep their limits, also of {DRAWS} arms whose links are heavier or lighter by {100 * WRONG:.0f} %."
        if strong.all()
        else "Torques keep the limits that are given."
    )
    low = "" if floor is None else f" The origins of all links stay above {floor:g} m; their shapes were not looked at."
    return [
        torque + low,
        "Collisions were NOT checked, neither with the arm itself nor with anything near it: play the motion in a "
        "simulator first.",
        "Friction that drifts while the arm warms up makes the intervals of a fit wider than these.",
    ]


def _shown(row: Expected) -> str:
    """Return a quantity as the fit prints it."""
    return str(Value(row.value, row.std_dev, row.unit, row.verdict, ""))


def _name(row: Expected) -> str:
    return f"{row.joint}, {row.name}" if row.joint else row.name
