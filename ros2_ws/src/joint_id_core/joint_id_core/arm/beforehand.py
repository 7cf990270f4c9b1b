"""What is known of the base parameters of an arm before any motion shows them: what its description says, roughly.

Where a joint stands, the torques of several parameters go together, and least squares would take any of the values that
explain them. So do joints whose motion is too small. There the description stays, with a standard deviation that tells
how little it promises.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.arm.regressor import OF_LINK, Regressor
from joint_id_core.data.recording import Array

SHARE = 2.0  # standard deviation of a mass, of first moments and inertias as far as the mass makes them
ROTOR = 3.0  # the same of each rotor, over the largest inertia of links that a joint moves
# Sizes that a body has at least, over the means of all: a tool or cables may be missing in the description.
LEAST_MASS, LEAST_LEVER = 0.1, 0.5
STATES = 60  # random poses that tell the largest inertia


@dataclass(frozen=True)
class Beforehand:
    """Values of the B base parameters, (B,), and their covariance, (B, B)."""

    values: Array
    covariance: Array

    @classmethod
    def of(cls, regressor: Regressor) -> Beforehand:
        """Return what the description of an arm tells."""
        count = len(regressor.joints)
        spread = ways(regressor, SHARE, regressor.lengths)
        rotors = regressor.composition[:, :count] * (ROTOR * _largest_inertia(regressor))
        return cls(regressor.reference, spread @ spread.T + rotors @ rotors.T)

    @property
    def sigma(self) -> Array:
        """Standard deviations, (B,)."""
        return np.sqrt(np.diag(self.covariance))

    def precision(self, count: int) -> Array:
        """Return the inverse of the covariance, with 0 for the other ones of `count` parameters, (count, count)."""
        sigma, base = self.sigma, len(self.values)
        found = np.zeros((count, count))
        scaled = self.covariance / np.outer(sigma, sigma)
        found[:base, :base] = np.linalg.inv(scaled) / np.outer(sigma, sigma)
        return found

    def of_all(self, count: int) -> Array:
        """Return the values, with 0 for the other ones of `count` parameters, (count,)."""
        return np.pad(self.values, (0, count - len(self.values)))


def ways(regressor: Regressor, share: float, least: Array | float = 0.0) -> Array:
    """Return what masses that are wrong by a `share` make of the base parameters, each in a column, (B, 10 n).

    `least`: distances in m of the masses from the frames of their joints, if they are larger than by the description.
    """
    masses, levers = regressor.bodies[:, 0], np.array([_lever(body) for body in regressor.bodies])
    masses = np.maximum(masses, LEAST_MASS * masses.mean())
    levers = np.maximum(np.maximum(levers, LEAST_LEVER * levers.mean()), least)
    powers = [0 if part == "mass" else 1 if part.startswith("m") else 2 for part in OF_LINK]
    sigma = share * masses[:, None] * levers[:, None] ** powers
    return np.asarray(regressor.composition[:, len(regressor.joints) :] * sigma.ravel())


def _lever(body: Array) -> float:
    """Return the distance of a body's mass from its joint's frame: its radius of gyration about the origin, in m."""
    mass, spread = body[0], body[4] + body[6] + body[9]
    return float(np.sqrt(max(0.0, 0.5 * spread / mass))) if mass > 0.0 else 0.0


def _largest_inertia(regressor: Regressor) -> float:
    """Return the largest inertia of links that a joint moves in random poses."""
    count = len(regressor.joints)
    q, own = np.random.default_rng(0).uniform(-np.pi, np.pi, (STATES, count)), np.eye(count)
    still = np.zeros_like(q)
    resting = regressor.rows(q, still, still)[0]
    moved = [regressor.rows(q, still, still + own[k])[0][:, k] - resting[:, k] for k in range(count)]
    return float(max(np.max(rows @ regressor.reference) for rows in moved))
