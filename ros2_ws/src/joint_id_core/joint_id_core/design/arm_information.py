"""How much a motion of an arm tells of its parameters, and by which change of the motion it would tell more.

The columns of the fit (`arm.equations`, `arm.friction`) as a function of the instant alone: without its filter, which
passes what an arm moves at. So the gradient of all instants needs one evaluation for each coordinate of a joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.friction import usual_load
from joint_id_core.arm.regressor import Regressor
from joint_id_core.data.recording import Array
from joint_id_core.design.arm_prior import ArmPrior

TURNS = 0.05  # rad/s over which Coulomb friction turns here: around a reversal the fit takes no equations
STEP = 1e-6  # rad, rad/s, rad/s^2, of differences
RIDGE = 1e-9  # of the information of a parameter, which keeps it regular where a motion shows nothing


@dataclass(frozen=True, eq=False)
class Chosen:
    """Parameters whose standard deviations shall be small: all others are only in the way.

    Attributes:
        mask: which they are, shape (P,).
        criterion: of `criterion.CRITERIA`.
        size: of each parameter, in whose units `A` adds up variances, shape (P,); None: as they are.
    """

    mask: NDArray[np.bool_]
    criterion: str = "sigma"
    size: Array | None = None

    def told(self, information: Array) -> tuple[float, Array]:
        """Return how much is told, and its derivative by the information (P, P).

        It is minus the sum of the logarithms of the variances; `D`: minus the logarithm of the determinant of their
        covariance; `A`: minus the logarithm of the mean variance, times their number. So all three are as large where
        the estimates do not correlate and are known alike. The first two do not depend on units.
        """
        scale = 1.0 / np.sqrt(np.diag(information))
        covariance = np.linalg.inv(information * np.outer(scale, scale) + RIDGE * np.eye(len(scale)))
        variances, mask = np.diag(covariance), self.mask
        if self.criterion == "D":
            rows = covariance[mask]
            block = rows[:, mask]
            value = -float(np.linalg.slogdet(block)[1] + 2.0 * np.log(scale[mask]).sum())
            slope = rows.T @ np.linalg.solve(block, rows)
        elif self.criterion == "A":
            weights = mask * (scale if self.size is None else scale / self.size) ** 2
            count, total = np.count_nonzero(mask), float(weights @ variances)
            value = -count * float(np.log(total / count))
            slope = count / total * (covariance * weights) @ covariance
        else:
            value = -float(np.log(variances * scale**2)[mask].sum())
            slope = (covariance * (mask / variances)) @ covariance
        return value, slope * np.outer(scale, scale)


class ArmColumns:
    """Torques of an arm by unit parameters: base parameters, damping, Coulomb friction, its growth with the load."""

    def __init__(self, regressor: Regressor, prior: ArmPrior) -> None:
        self._regressor, self._count = regressor, len(regressor.joints)
        self._usual = usual_load(regressor)
        self._load = regressor.reference.copy()
        self.count = len(regressor.reference) + 2 * self._count + 1
        self._weights = 1.0 / prior.noise

    def at(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the columns, shape (T, n, P), of motions of shape (T, n)."""
        base = self._regressor.rows(q, dq, ddq)[0]
        own, sign = np.eye(self._count), np.tanh(dq / TURNS)
        growth = (np.abs(base @ self._load) - self._usual) * sign
        return np.concatenate([base, dq[:, :, None] * own, sign[:, :, None] * own, growth[:, :, None]], axis=2)

    def information(self, columns: Array) -> tuple[Array, Array]:
        """Return the information (P, P) of columns, and the weighted columns without their means (T, n, P).

        Every joint has a torque offset of its own, which takes the mean away.
        """
        left = (columns - columns.mean(axis=0)) * self._weights[:, None]
        flat = left.reshape(-1, columns.shape[2])
        return flat.T @ flat, left * self._weights[:, None]

    def slopes(self, state: tuple[Array, Array, Array], columns: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return derivatives of sum(weights * columns) by position, velocity, acceleration, each of shape (T, n)."""
        found = np.empty((3, *state[0].shape))
        for order in range(3):
            for j in range(self._count):
                moved = [part.copy() for part in state]
                moved[order][:, j] += STEP
                found[order, :, j] = np.einsum("tnp,tnp->t", weights, self.at(*moved) - columns) / STEP
        return found[0], found[1], found[2]
