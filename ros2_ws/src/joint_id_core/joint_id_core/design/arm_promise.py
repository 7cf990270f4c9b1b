"""What `joint-id arm fit` will tell of a motion of an arm: its own equations of the planned motion, and the noise.

The filter, the instants that are left out around reversals and the law of friction are those of the fit. So is the
covariance: least squares weighed by the noise of each joint, under a noise that has a memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.equations import KEPT, PAYLOAD, RATE, Equations, unchecked
from joint_id_core.arm.fit import BENT, SURE
from joint_id_core.arm.friction import Friction
from joint_id_core.arm.judged import ACCURACY
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import Stacked
from joint_id_core.data.recording import Array, Recording
from joint_id_core.design.arm_prior import ArmPrior
from joint_id_core.design.trajectory import Trajectory

Places = NDArray[np.intp]
SAMPLES = 500.0  # in a second, of the recording
FORGETS_S = 1e-3  # least memory of noise
STILL_S = 0.5  # recorded before and after the motion: derivatives need samples beyond it


@dataclass(frozen=True, eq=False)
class Promise:
    """What a fit will tell.

    Attributes:
        values: that are taken: base parameters (rotors first), damping, Coulomb friction, bends, gears that yield (0:
            that they are stiff is not known, and makes the others less known), growth, shape (P,).
        std_dev: of each, shape (P,); NaN where the motion shows nothing.
        effect: root mean square in Nm of the torque that each makes, over the joint where it makes most of the noise
            there, shape (P,).
        bent: by how much damping and Coulomb friction are known worse as nobody knows whether friction bends, median.
        condition: condition number of the regressor of the base parameters, what other tools make small.
    """

    values: Array
    std_dev: Array
    effect: Array
    bent: tuple[float, float]
    condition: float


def promise(regressor: Regressor, trajectory: Trajectory, prior: ArmPrior) -> Promise:
    """Return what a fit of a recording of a motion will tell of an arm.

    Raises:
        JointIdError: the motion is too short for the number of parameters.
    """
    part = _equations(regressor, trajectory)
    base, count = part.base, len(regressor.joints)
    values = np.concatenate([prior.values(regressor)[:-1], prior.bend, np.zeros(2 * count), [prior.growth]])
    first, table = base + 2 * count, Stacked.of([part])
    more = np.append(np.arange(first, first + count), len(values) - 1)  # bends and growth
    whole = _covariance(part, table, prior, np.zeros(0, dtype=np.intp))
    weak, least = _weak(values, whole, more, prior)
    sigma = np.sqrt(np.diag(_covariance(part, table, prior, weak)) + _by_chance(whole, weak, least))
    straight = np.sqrt(np.diag(_covariance(part, table, prior, np.arange(first, first + count))))
    seen = np.any(table.columns != 0.0, axis=0)
    seen[weak] = False
    friction = slice(base, first)
    worse = np.median((sigma[friction] / straight[friction]).reshape(2, -1), axis=1)
    sigma[friction] = np.hypot(sigma[friction], ACCURACY * values[friction])
    weights = 1.0 / prior.noise[table.joint]
    squares = np.array(
        [np.bincount(table.joint, (column * weights) ** 2, count) for column in table.columns.T]
    ) / np.maximum(1, np.bincount(table.joint, minlength=count))
    inertial = table.columns[:, :base]
    return Promise(
        values,
        np.where(seen, sigma, np.nan),
        np.sqrt(squares.max(axis=1)) * np.abs(np.nan_to_num(values)),
        (float(worse[0]), float(worse[1])),
        float(np.linalg.cond(inertial)),
    )


def _equations(regressor: Regressor, trajectory: Trajectory) -> Equations:
    """Return the equations of a recording of the motion without noise."""
    count = round((trajectory.duration + 2.0 * STILL_S) * SAMPLES) + 1
    time = np.arange(count) / SAMPLES
    q = trajectory.at(time - STILL_S).position
    records = {
        name: Recording(
            time, {"link_position": q[:, k], "torque": np.zeros(count)}, source="the planned motion", joint=name
        )
        for k, name in enumerate(trajectory.names)
    }
    part = unchecked(regressor, records, {name: {"torque": 1.0} for name in regressor.joints}, "the planned motion")
    values = np.concatenate([regressor.reference, np.zeros(PAYLOAD)])
    return Friction.from_values(regressor, values).added(part)


def _weak(values: Array, covariance: Array, more: Places, prior: ArmPrior) -> tuple[Places, Array]:
    """Return which places of bends and growth, `more`, a fit leaves out, and the sizes that it would keep.

    A bend that is not known is kept.
    """
    sigma = np.sqrt(np.diag(covariance)[more])
    least = np.maximum(SURE * sigma, np.append(BENT * prior.coulomb, 0.0))
    out = np.abs(values[more]) <= least
    return more[out], least[out]


def _by_chance(covariance: Array, weak: Places, least: Array) -> Array:
    """Return the variance that parameters get as a fit takes bends for real that are noise, shape (P,).

    It does so where the noise makes one larger than `least`, and moves the other parameters then as the covariance of
    all of them says: E[x^2; |x| > t] = 2 (t phi(t) + Q(t)) of the variance that the bend takes from them.
    """
    found = np.zeros(len(covariance))
    for k, size in zip(weak, least, strict=True):
        if covariance[k, k] > 0.0:
            t = size / np.sqrt(covariance[k, k])
            share = t * np.sqrt(2.0 / np.pi) * np.exp(-(t**2) / 2.0) + math.erfc(t / math.sqrt(2.0))
            found += share * covariance[:, k] ** 2 / covariance[k, k]
    return found


def _covariance(part: Equations, table: Stacked, prior: ArmPrior, without: Places) -> Array:
    """Return the covariance (P, P) of a fit of the equations without some parameters; 0 for those."""
    columns = table.without(without).columns
    size = np.linalg.norm(columns, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    whole, middle = np.zeros((2, len(size), len(size)))
    for j, (noise, memory) in enumerate(zip(prior.noise, prior.memory, strict=True)):
        own = columns[table.joint == j] / scale / noise
        instants = np.flatnonzero(part.used[:, j]) * KEPT / RATE
        alike = np.exp(-np.abs(instants[:, None] - instants) / max(memory, FORGETS_S))
        whole += own.T @ own
        middle += own.T @ alike @ own
    before = table.precision / np.outer(scale, scale)
    inverse = np.linalg.pinv(whole + before, hermitian=True, rcond=1e-13)
    return np.asarray(inverse @ (middle + before) @ inverse / np.outer(scale, scale))
