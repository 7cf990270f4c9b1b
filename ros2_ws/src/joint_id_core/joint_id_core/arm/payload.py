"""What an arm carries, from recordings with and without it; or, if its mass is known, the torque constants.

The payload adds to the inertial parameters of the last link, in some recordings only. All torques and masses of an arm
scale with the gains of its drives; one mass that was weighed tells them (as Gautier & Briot, Journal of Intelligent &
Robotic Systems 2014, do with a payload).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.equations import PAYLOAD, Equations
from joint_id_core.arm.stacked import Stacked, solved
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.results.verdict import MAGNITUDE

ITERATIONS = 50
IMPOSSIBLE = 2.0  # standard deviations below zero from which a mass is told to be none
SETTLED = 1e-6  # change of the gains, relative


@dataclass(frozen=True)
class Factor:
    """By what the recorded torque of a joint, or its gain, is multiplied to be right, with its standard deviation.

    That is NaN if nothing is known of it.
    """

    joint: str
    value: float
    std_dev: float

    @property
    def known(self) -> bool:
        """Whether anything is known of it."""
        return math.isfinite(self.std_dev)

    def __str__(self) -> str:
        """Return it as text."""
        return f"{self.joint} {self.value:.4g} ± {self.std_dev:.2g}" if self.known else f"{self.joint} not known"


@dataclass(frozen=True)
class Payload:
    """Mass in kg, and centre of mass in m in the frame of the link that carries it, with standard deviations."""

    link: str
    mass: float
    mass_std_dev: float
    centre: tuple[float, float, float]
    centre_std_dev: tuple[float, float, float]

    @property
    def known(self) -> bool:
        """Whether the mass is that of a body, and known to half of its value."""
        return self.mass_std_dev <= MAGNITUDE * self.mass

    def __str__(self) -> str:
        """Return it in words."""
        if not self.known:
            found = f"payload on {self.link}: not known, {self.mass:.2g} ± {self.mass_std_dev:.2g} kg"
            less = self.mass < -IMPOSSIBLE * self.mass_std_dev
            return (
                f"{found}, which no body has: the torques hold what the description of the arm lacks" if less else found
            )
        place = ", ".join(f"{c:.3g} ± {s:.1g}" for c, s in zip(self.centre, self.centre_std_dev, strict=True))
        return (
            f"payload on {self.link}: {self.mass:.4g} ± {self.mass_std_dev:.2g} kg, centre at ({place}) m in its frame"
        )


def payload_of(link: str, values: Array, covariance: Array) -> Payload:
    """Return the payload from its ten inertial parameters (10,) and their covariance (10, 10)."""
    mass, moments = float(values[0]), values[1:4]
    centre = moments / mass if mass else np.full(3, np.nan)
    slope = np.column_stack([-centre / mass, np.eye(3) / mass]) if mass else np.full((3, 4), np.nan)
    spread = np.sqrt(np.diag(slope @ covariance[:4, :4] @ slope.T))
    x, y, z = centre.tolist()
    dx, dy, dz = spread.tolist()
    return Payload(link, mass, float(np.sqrt(covariance[0, 0])), (x, y, z), (dx, dy, dz))


def gains_from_mass(parts: Sequence[Equations], mass: float, beforehand: Beforehand) -> tuple[Array, Array]:
    """Return factors on the torques of all joints with which the payload has this mass, and their sigma, shape (n,).

    Those of a joint that stands are 1, with a sigma of NaN. Gauss-Newton: the torque that was recorded is that of the
    masses over the factor, and friction. Of friction, what grows with the load has one parameter for all joints, so it
    is over the factor, too.

    Args:
        parts: equations with all columns of friction.
        mass: of the payload in kg.
        beforehand: what is known of the arm.

    Raises:
        JointIdError: no recording has the payload or none is without it, the mass is not above 0, or the iteration
            does not settle.
    """
    if not 0.0 < mass < np.inf:
        raise JointIdError(f"a payload of {mass:g} kg tells no torque constant: give its mass in kg, above 0")
    if all(part.loaded for part in parts) or not any(part.loaded for part in parts):
        raise JointIdError("torque constants need recordings with the payload and others without it")
    table, first = Stacked.of(parts, beforehand), parts[0].base
    values, _ = table.weighed()
    values[first], n = mass, table.count
    free = np.delete(np.arange(table.columns.shape[1]), first)
    share, place = np.ones(n), np.arange(len(values))
    shared = (place < first + PAYLOAD) | (place == place[-1])  # parameters that are not of a joint alone
    of_joint = table.joint[:, None] == np.arange(n)
    expected = np.append(beforehand.of_all(len(values))[free], np.ones(n))
    precision = np.zeros((len(expected), len(expected)))
    precision[:-n, :-n] = np.asarray(table.precision)[np.ix_(free, free)]
    for _ in range(ITERATIONS):
        rigid = table.columns[:, shared] @ values[shared]
        scaled = np.where(shared, share[table.joint, None], 1.0) * table.columns
        left = table.y - scaled @ values
        sigma = table.scatter(left)
        columns = np.concatenate([scaled[:, free], np.where(of_joint, rigid[:, None], 0.0)], axis=1)
        y = left + columns @ (np.append(values[free], share) - expected)
        new = expected + solved(columns / sigma[table.joint, None], y / sigma[table.joint], precision)
        step, share, values[free] = new[-n:] - share, new[-n:], new[:-n]
        if np.abs(step).max() < SETTLED:
            spread = np.sqrt(np.diag(table.covariance(columns, left, sigma, precision)[0])[-n:])
            still = np.bincount(table.joint, minlength=n) == 0
            return 1.0 / share, np.where(still, np.nan, spread / share**2)
    raise JointIdError("no torque constants with which the payload has this mass: check the mass and the recordings")
