"""What is known of a followed arm, as an estimate of each joint and of its payload."""

from __future__ import annotations

import math

import numpy as np

from joint_id_core.arm.belief import Belief
from joint_id_core.arm.changes import PAYLOAD
from joint_id_core.arm.follower import ArmFollower
from joint_id_core.arm.judged import friction, rotor
from joint_id_core.arm.links import IMPOSSIBLE
from joint_id_core.arm.payload import Payload, payload_of
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.rests import LEAST_R_SQUARED
from joint_id_core.arm.straight import straightened
from joint_id_core.results.estimate import Estimate, ParameterChange, ParameterEstimate, Status, message
from joint_id_core.results.verdict import MAGNITUDE, Verdict

MODEL, ESTIMATOR = "arm", "recursive"
# Of each joint, at the link: rotor, viscous and Coulomb friction as in the model `rigid_joint`, torque offset.
UNITS = {"J_r": "kg m^2", "c": "Nm s/rad", "tau_f": "Nm", "tau_0": "Nm"}


def joint_estimates(follower: ArmFollower, regressor: Regressor, source: str) -> dict[str, Estimate]:
    """Return an estimate of each joint; times count from the begin of the samples."""
    nan, belief = float("nan"), follower.belief
    end = 0.0 if math.isnan(follower.time) else follower.time
    if belief is None:
        unknown = tuple(
            ParameterEstimate(name, unit, nan, nan, Verdict.NOT_EXCITED, reason="not learnt yet")
            for name, unit in UNITS.items()
        )
        text = f"Learning the arm: {follower.motion:.0f} of {follower.needed:.0f} s of motion."
        return {
            name: Estimate(
                MODEL, ESTIMATOR, Status.TOO_SHORT, text, unknown, start=0.0, end=end, source=source,
                joint=name, notes=(text,),
            )
            for name in regressor.joints
        }  # fmt: skip
    belief = straightened(belief)
    return {
        name: _of_joint(follower, belief, regressor, j).updated(source=source, start=0.0, end=end)
        for j, name in enumerate(regressor.joints)
    }


def payload(follower: ArmFollower, regressor: Regressor) -> Payload | None:
    """Return what the arm carries beside what it carried when it was learnt; None if nothing, or that is not known."""
    belief = follower.belief
    if belief is None or not belief.carries:
        return None
    place = belief.payload
    return payload_of(regressor.last_link, belief.values[place], belief.told_covariance[place, place])


def payload_text(follower: ArmFollower, regressor: Regressor) -> str:
    """Return that in words."""
    if follower.belief is None:
        return f"Learning the arm: {follower.motion:.0f} of {follower.needed:.0f} s of motion."
    found = payload(follower, regressor)
    told = f"{found}." if found is not None else "No payload beside what the arm carried when it was learnt."
    if PAYLOAD in follower.changes:
        told = f"Changed: {told}"
    if follower.unexplained:
        told += f" {_unexplained(follower)}"
    return told[0].upper() + told[1:]


def _of_joint(follower: ArmFollower, belief: Belief, regressor: Regressor, j: int) -> Estimate:
    """Return the estimate of a joint of an arm that is known."""
    name = regressor.joints[j]
    places = np.array([j, *belief.friction_of(j)[:2], belief.offsets.start + j])
    told = belief.told_covariance[np.ix_(places, places)]
    sigma, seen = np.sqrt(np.diag(told)), belief.seen[places]
    values = [float(value) for value in belief.values[places]]
    quantities = [rotor(regressor, j, values[0], float(sigma[0]), bool(seen[0]))]
    for k, parameter in ((1, "c"), (2, "tau_f")):
        spread = float(np.hypot(sigma[k], belief.drift[k - 1] * values[k]))  # it is another one in the next minute
        quantities.append(friction(values[k], spread, UNITS[parameter], bool(seen[k])))
    rows = [
        ParameterEstimate(parameter, q.unit, q.value, q.std_dev, q.verdict, reason=q.reason)
        for parameter, q in zip(("J_r", "c", "tau_f"), quantities, strict=True)
    ]
    rows.append(_offset(values[3], float(sigma[3]), values[2], bool(seen[3])))
    deviations = np.array([row.std_dev for row in rows])
    free = [k for k in range(len(rows)) if np.isfinite(deviations[k])]
    scale = deviations[free] / sigma[free]
    covariance = told[np.ix_(free, free)] * np.outer(scale, scale)
    r_squared = float(belief.r_squared[j])
    pulled = all(q.verdict is Verdict.AT_BOUND for q in quantities[1:]) or values[0] < -IMPOSSIBLE * sigma[0]
    status, notes = _status(follower, name, r_squared, pulled or bool(belief.faults.gross)), []
    if follower.rests:
        notes.append("The arm rests: what is known of it stays.")
    elif status is Status.NO_MOTION:
        notes.append(f"{name} has not moved since the arm is followed: move it to know its rotor and its friction.")
    elif belief.faults.gross:
        notes.append(f"The torques contradict the description: {belief.faults.gross}.")
    elif name in follower.unexplained:
        notes.append(_unexplained(follower))
    elif pulled:
        notes.append("Friction or inertia is pulled below zero, as of a drive that is recorded with the other sign.")
    elif status is Status.POOR_FIT:
        notes.append(
            f"Only {100.0 * r_squared:.0f} % of the torque are explained: another load acts on the joint, or the "
            "description, the gear ratio or the torque constant is wrong."
        )
    else:
        notes.append("Converged.")
    changes = _changes(follower, belief, name, j)
    notes += [change.text for change in changes]
    notes += [fault_text(belief)] if status is Status.CONVERGED and belief.faults.texts else []
    notes += [f"J_r: {rows[0].reason}."] if rows[0].reason else []
    return Estimate(
        MODEL, ESTIMATOR, status, message(notes), tuple(rows), tuple(rows[k].name for k in free),
        covariance, nrmse={"torque": float(np.sqrt(max(0.0, 1.0 - r_squared)))},
        noise={"torque": float(belief.sigma[j])}, joint=name, notes=tuple(notes), changes=changes,
        whiteness={}, samples=follower.used,
    )  # fmt: skip


def fault_text(belief: Belief) -> str:
    """Return the faults of the samples from which an arm was learnt, as a sentence."""
    return f"While the arm was learnt, {'; '.join(belief.faults.texts)}: the intervals contain it."


def _status(follower: ArmFollower, name: str, r_squared: float, contradicted: bool) -> Status:
    if follower.rests or math.isnan(r_squared):
        return Status.NO_MOTION
    poor = contradicted or name in follower.unexplained or not r_squared > LEAST_R_SQUARED
    return Status.POOR_FIT if poor else Status.CONVERGED


def _unexplained(follower: ArmFollower) -> str:
    return (
        f"The torque of {', '.join(follower.unexplained)} is not explained now, by no payload and no friction: "
        "something touches the arm, or a load moves with it. Nothing is learnt from that."
    )


def _offset(value: float, sigma: float, coulomb: float, seen: bool) -> ParameterEstimate:
    """Return the torque offset: what a sensor adds, and friction that is not the same in both directions."""
    if not seen:
        return ParameterEstimate("tau_0", "Nm", float("nan"), float("nan"), Verdict.NOT_EXCITED)
    known = sigma < MAGNITUDE * max(abs(value), abs(coulomb))
    return ParameterEstimate("tau_0", "Nm", value, sigma, Verdict.ESTIMATED if known else Verdict.PRIOR)


def _changes(follower: ArmFollower, belief: Belief, name: str, j: int) -> tuple[ParameterChange, ...]:
    """Return what changed in a joint, if anything did."""
    change, found = follower.changes.get(name), []
    if change is not None:
        before = straightened(change.before)
        for k, parameter in zip(belief.friction_of(j)[:2], ("c", "tau_f"), strict=True):
            pair = [(float(b.values[k]), float(np.sqrt(b.covariance[k, k]))) for b in (before, belief)]
            found.append(ParameterChange(parameter, *pair[0], *pair[1], change.since))
    return tuple(found)
