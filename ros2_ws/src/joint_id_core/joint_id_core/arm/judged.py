"""What values and standard deviations of an arm's parameters tell of its joints: quantities with their verdicts."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.arm_estimate import BaseParameter, Value
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array
from joint_id_core.results.verdict import MAGNITUDE, Verdict

# Of friction at best, as a share. What reversals leave of it, whatever the law by which friction turns there, is in the
# residuals and so in the covariance; this is for lengths and times, which nobody knows better.
ACCURACY = 2e-4
LEARNED = 0.5  # share of the standard deviation without recordings below which they have told something
BOUND = 1.96  # standard deviations below zero from which the data, and not chance, ask for a negative value


def rotor(regressor: Regressor, j: int, value: float, sigma: float, seen: bool) -> Value:
    """Return the inertia of a rotor seen at the link, beside what the description says of the links.

    Args:
        regressor: of the arm.
        j: number of the joint.
        value, sigma: of its base parameter in kg m^2.
        seen: whether a motion has shown it.
    """
    found = _positive(value - float(regressor.reference[j]), sigma, "kg m^2", seen)
    return found if regressor.alone[j] else found.beside("beside the inertia of its links in the description")


def beside_bodies(found: Value, rotor: float) -> Value:
    """Return the inertia of a rotor with the interval that holds that beside the bodies of the fit, if there is one."""
    if found.verdict is not Verdict.ESTIMATED or not rotor > 0.0:
        return found
    beyond = max(0.0, abs(found.value - rotor) - found.std_dev)  # less is chance
    wide = _positive(found.value, math.hypot(found.std_dev, beyond), found.unit, True)
    return wide.beside(found.reason) if found.reason else wide


def friction(value: float, sigma: float, unit: str, seen: bool) -> Value:
    """Return a friction, which is known no better than the filters allow."""
    return _positive(value, float(np.hypot(sigma, ACCURACY * value)), unit, seen)


def base_parameters(
    regressor: Regressor, values: Array, sigma: Array, seen: NDArray[np.bool_], before: Array | float = np.inf
) -> tuple[BaseParameter, ...]:
    """Return the base parameters, which come first in arrays of shape (P,).

    `before`: their standard deviations without the recordings, (B,), if anything was known then.
    """
    known = np.broadcast_to(before, regressor.reference.shape)
    rows = zip(regressor.combinations, values, sigma, regressor.reference, seen, known, strict=False)
    return tuple(BaseParameter(t, float(v), float(s), float(r), _verdict(v, s, r, k, b)) for t, v, s, r, k, b in rows)


def _positive(value: float, sigma: float, unit: str, seen: bool) -> Value:
    """Return a quantity that cannot be negative, with its verdict."""
    if not seen:
        return Value(float("nan"), float("nan"), unit, Verdict.NOT_EXCITED, "the joint does not move")
    if value < -BOUND * sigma:
        told = f"the data pull it below 0, to {value:.3g} ± {sigma:.2g} {unit}"
        return Value(0.0, sigma, unit, Verdict.AT_BOUND, told)
    if sigma > MAGNITUDE * value:
        told = f"it lies below about {max(value, 0.0) + 2.0 * sigma:.2g} {unit}, more is not known"
        return Value(max(value, 0.0), sigma, unit, Verdict.PRIOR, told)
    return Value(value, sigma, unit, Verdict.ESTIMATED, "")


def _verdict(value: float, sigma: float, reference: float, seen: bool, before: float) -> Verdict:
    """Return whether a base parameter is known to half of its value, or of that of the description, by the motion."""
    if not seen:
        return Verdict.NOT_EXCITED
    if sigma > LEARNED * before:
        return Verdict.PRIOR
    return Verdict.ESTIMATED if sigma < MAGNITUDE * max(abs(value), abs(reference)) else Verdict.PRIOR
