"""`joint_id.fit_arm`."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from joint_id_core.arm.arm_estimate import ArmEstimate
from joint_id_core.arm.arm_estimate import Value as OfArm
from joint_id_core.arm.description import Description
from joint_id_core.arm.equations import SLOW
from joint_id_core.arm.fit import fit_arm
from joint_id_core.arm.friction import bend
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array, Recording
from joint_id_core.results.verdict import Verdict
from robots.arm_peers.found import Found, scores
from robots.arm_peers.logs import Log
from robots.fitted import Value

PACKAGE = ""  # it is the project


def fit(urdf: str, log: Log, others: Sequence[Log]) -> Found:
    """Fit a log, and predict the others."""
    description = Description(urdf)
    begun = time.process_time()
    estimate = fit_arm(description, [recordings(log)], {name: {"torque": 1.0} for name in log.joints})
    cpu_s = time.process_time() - begun
    friction = {
        "damping": [_known(j.damping) for j in estimate.joints],
        "friction": [_known(j.friction) for j in estimate.joints],
    }
    judged = scores(lambda other: torque(estimate, description, other), others)
    links = estimate.links.links
    return Found(friction, *judged, [one.rotor for one in links], [one.found.mass for one in links], cpu_s)


def torque(estimate: ArmEstimate, description: Description, log: Log) -> Array:
    """Torques of the motion of a log, shape (T, n), without offsets."""
    q, dq, ddq = log.motion()
    regressor = Regressor(description)
    columns, values = regressor.rows(q, dq, ddq)[0], np.array([p.value for p in estimate.parameters])
    count, links = len(regressor.joints), values.copy()
    links[:count] = regressor.reference[:count]  # without rotors
    damping, friction = (np.array([getattr(j, n).value for j in estimate.joints]) for n in ("damping", "friction"))
    usual, bent = (np.array([getattr(j, n) for j in estimate.joints]) for n in ("load", "bend"))
    growth = estimate.by_load.value if estimate.by_load.verdict is Verdict.ESTIMATED else 0.0
    coulomb = friction + growth * (np.abs(columns @ links) - usual)
    return np.asarray(columns @ values + damping * dq + coulomb * np.tanh(dq / SLOW) + bent * bend(dq))


def recordings(log: Log) -> dict[str, Recording]:
    """The log as `fit_arm` takes it."""
    return {
        name: Recording(log.time, {"link_position": log.q[:, k], "torque": log.torque[:, k]}, log.name, joint=name)
        for k, name in enumerate(log.joints)
    }


def _known(found: OfArm) -> Value:
    known = found.verdict is Verdict.ESTIMATED
    return Value(found.value, found.std_dev if known else float("nan"), found.verdict.value)
