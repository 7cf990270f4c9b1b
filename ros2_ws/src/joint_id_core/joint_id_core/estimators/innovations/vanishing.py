"""Positive parameters that are hardly known, beside others that do the same to the motion."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum

UNKNOWN = 1.0  # standard deviation of a logarithm from which only its prior says how large a parameter is
WITHIN = 2.0  # standard deviations of the prior up to which such a parameter may be larger


def of_vanishing(cost: Cost, found: Minimum, apart: Collection[str] = ()) -> Array:
    """Return what positive parameters that are hardly known add to the covariance of the others, shape (k, k).

    Viscous friction of motor and link, for instance: the estimate may leave all of it to one of them. The other one is
    then small and moves nothing in its logarithm, and the first would be known as if the other were as small for
    certain. In its plain value it may be as large as its prior believes: a prior of the logarithm that is weaker.
    Parameters that are told `apart` stay as they are.
    """
    coordinates, belief = cost.coordinates, cost.belief
    precision = np.diag(belief.precision)
    asked = np.array([name not in apart for name in cost.recursion.data.free])
    unknown = coordinates.positive & (np.diag(found.inverse) > UNKNOWN**2) & asked
    excess = np.zeros_like(found.hessian)
    if not unknown.any():
        return excess
    largest = belief.mean + WITHIN / np.sqrt(precision) + _stiffer(cost, found)
    plain = np.exp(2.0 * np.minimum(found.z - largest, 0.0))  # precision that the plain value has, at its logarithm
    weaker = np.where(unknown, np.minimum(precision, plain), precision)
    hessian = found.hessian - np.diag(precision - weaker)
    size = np.sqrt(np.maximum(np.diag(hessian), np.finfo(float).tiny))
    inverse = np.linalg.pinv(hessian / np.outer(size, size), hermitian=True) / np.outer(size, size)
    both = np.ix_(~unknown, ~unknown)
    excess[both] = inverse[both] - found.inverse[both]
    return excess


def _stiffer(cost: Cost, found: Minimum) -> Array:
    """Return by how much more than its prior says the cubic stiffness may be larger, in its logarithm, shape (k,).

    A gear that is found ten times stiffer than believed twists a tenth under the same torque. The cubic part then
    passes on as much of it with a stiffness that is a thousand times larger.
    """
    data, more = cost.recursion.data, np.zeros(len(found.z))
    linear, cubic = data.model.stiffness, data.model.cubic_stiffness
    if linear in data.free and cubic in data.free:
        at = data.free.index(linear)
        more[data.free.index(cubic)] = 3.0 * max(0.0, found.z[at] - cost.belief.mean[at])
    return more
