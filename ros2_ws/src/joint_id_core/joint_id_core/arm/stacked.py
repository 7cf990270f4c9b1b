"""The equations of all recordings and joints of an arm in one table, and weighted least squares of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.autoregressive import autoregressive
from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.equations import PAYLOAD, Equations
from joint_id_core.data.recording import Array
from joint_id_core.errors import JointIdError
from joint_id_core.estimators.regression.covariance import automatic_lag, newey_west

WEIGHINGS = 3  # passes that weigh the joints
LEAST_ROWS = 2.0  # equations by parameter
LEAST_FREE = 0.01  # share of an equation that others do not determine
DUST = 1e-9  # size of a column over that of the largest one which is the rounding of a joint that stands
ROUNDED = 1e-13  # smallest singular value of normal equations that rounding does not make


@dataclass(frozen=True)
class Stacked:
    """Equations without the means of each recording and joint, which are its torque offsets (Frisch & Waugh).

    Attributes:
        y, columns: torques (T,), and by unit parameters (T, P): base parameters, those of the payload if there is one,
            viscous and Coulomb friction.
        joint, pieces: of each, the number of the joint, and of recording and joint, (T,).
        count: of joints, n.
        expected, precision: values of the parameters that are known beforehand, (P,), and the inverse of their
            covariance, (P, P); 0 if nothing is.
    """

    y: Array
    columns: Array
    joint: NDArray[np.intp]
    pieces: NDArray[np.int64]
    count: int
    precision: Array | float = 0.0
    expected: Array | float = 0.0

    @classmethod
    def of(cls, parts: Sequence[Equations], beforehand: Beforehand | None = None) -> Stacked:
        """Stack the equations of recordings, with what is known beforehand of the base parameters.

        Raises:
            JointIdError: they are fewer than twice the parameters.
        """
        count, loaded = parts[0].y.shape[1], any(part.loaded for part in parts)
        rows = [(part, j) for part in parts for j in range(count)]
        tables = [of_joint(part, j, loaded) for part, j in rows]
        y, columns = (np.concatenate([centred(pair[i]) for pair in tables]) for i in (0, 1))
        size = np.linalg.norm(columns, axis=0)
        columns[:, size < DUST * size.max()] = 0.0
        if len(y) < LEAST_ROWS * columns.shape[1]:
            raise JointIdError(
                f"{len(y)} equations are too few for the {columns.shape[1]} parameters of this arm: record longer"
            )
        lengths = [len(pair[0]) for pair in tables]
        pieces = np.repeat(np.arange(len(rows)), lengths)
        known = parts[0].precision
        if not loaded:
            known = np.delete(known, place_of_payload(parts[0]))
        table = cls(y, columns, np.repeat([j for _, j in rows], lengths), pieces, count, np.diag(known))
        if beforehand is None:
            return table
        precision = table.precision + beforehand.precision(len(known))
        return replace(table, precision=precision, expected=beforehand.of_all(len(known)))

    def without(self, places: NDArray[np.intp]) -> Stacked:
        """Return the same with some parameters that are 0."""
        columns = self.columns.copy()
        columns[:, places] = 0.0
        return replace(self, columns=columns)

    def weighed(self) -> tuple[Array, Array]:
        """Return values (P,), and standard deviations of what is left of the torque of each joint, shape (n,)."""
        expected = np.broadcast_to(self.expected, self.columns.shape[1])
        values, sigma = expected, np.ones(self.count)
        for _ in range(WEIGHINGS):
            weights = 1.0 / sigma[self.joint]
            left = (self.y - self.columns @ expected) * weights
            values = expected + solved(self.columns * weights[:, None], left, self.precision)
            sigma = self.scatter(self.y - self.columns @ values)
        return values, sigma

    def by_gain(self, sigma: Array) -> Array:
        """Return by how much the values change with the torque of each joint, relative to it, shape (P, n).

        `sigma`: of what is left of the torque of each joint, (n,), as from `weighed`.
        """
        weights = 1.0 / sigma[self.joint]
        own = np.where(self.joint[:, None] == np.arange(self.count), (self.y * weights)[:, None], 0.0)
        return solved(self.columns * weights[:, None], own, self.precision)

    def scatter(self, left: Array) -> Array:
        """Return the standard deviation of residuals (T,) by joint, shape (n,); 1 where there are none."""
        squares, counts = np.bincount(self.joint, left**2, self.count), np.bincount(self.joint, minlength=self.count)
        sigma = np.sqrt(squares / np.maximum(counts, 1))
        return np.where(sigma > 0.0, sigma, 1.0)

    def covariance(
        self, columns: Array, left: Array, sigma: Array, precision: Array | float = 0.0
    ) -> tuple[Array, float]:
        """Return the covariance of values with these columns (T, k) and residuals (T,), and the lag of their memory.

        `precision` is that of these values, (k, k) or 0.

        Of each standard deviation it is the larger one of two: what the residuals show, and what noise with their first
        autocorrelation does.

        An equation that alone tells of a parameter leaves nothing, however wrong it is. So residuals are those of a fit
        without their own equation (MacKinnon & White, Journal of Econometrics 29, 1985).
        """
        weights = 1.0 / sigma[self.joint]
        weighted = columns * weights[:, None]
        alone = free(weighted)
        residuals = left * weights / alone
        scores, lag = weighted * residuals[:, None], 1.0
        for k in np.unique(self.pieces):
            some = scores[self.pieces == k]
            lag = max(lag, automatic_lag(some[:, np.any(some, axis=0)]))
        shown = newey_west(weighted, residuals, self.pieces, lag, precision)
        whole = left * weights / np.sqrt(alone)  # a fit takes some of the noise for motion
        modelled = np.diag(autoregressive(weighted, whole, self.joint, self.pieces, lag, precision))
        own = np.diag(shown)
        wider = np.sqrt(np.maximum(1.0, modelled / np.where(own > 0.0, own, np.inf)))
        return shown * np.outer(wider, wider), lag


def of_joint(part: Equations, j: int, loaded: bool) -> tuple[Array, Array]:
    """Return torques (T,) and columns (T, P) of the equations of a joint; with those of a payload if `loaded`."""
    used, place = part.used[:, j], place_of_payload(part)
    columns = part.columns[used, j]
    if not loaded:
        return part.y[used, j], np.delete(columns, place, axis=1)
    if not part.loaded:
        columns = columns.copy()
        columns[:, place] = 0.0
    return part.y[used, j], columns


def place_of_payload(part: Equations) -> slice:
    """Return the place of the parameters of a payload."""
    return slice(part.base, part.base + PAYLOAD)


def free(weighted: Array) -> Array:
    """Return one less the leverage of each equation, shape (T,), of weighted columns (T, P)."""
    size = np.linalg.norm(weighted, axis=0)
    scaled = weighted / np.where(size > 0.0, size, 1.0)
    leverage = np.sum(scaled @ np.linalg.pinv(scaled.T @ scaled, hermitian=True) * scaled, axis=1)
    return np.asarray(np.maximum(1.0 - leverage, LEAST_FREE))


def centred(values: Array) -> Array:
    """Return values without their mean."""
    return values - values.mean(axis=0) if len(values) else values


def solved(table: Array, y: Array, precision: Array | float = 0.0) -> Array:
    """Return least squares of y, (T,) or (T, m).

    They are 0 for columns that are zero, and the shortest solution where columns depend.

    `precision`: the inverse of the covariance of the parameters about 0 that is known beforehand, (P, P), or 0, in the
    units of the table.
    """
    size = np.linalg.norm(table, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    scaled = table / scale  # normal equations, which take a hundredth of the time: base parameters hardly depend
    normal = scaled.T @ scaled + precision / np.outer(scale, scale)
    found = np.linalg.lstsq(normal, scaled.T @ y, rcond=ROUNDED)[0]
    return np.asarray(((size > 0.0) * found.T / scale).T)
