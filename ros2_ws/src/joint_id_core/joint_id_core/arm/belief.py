"""What is known of an arm: a Gaussian of all its parameters, which every new stretch of motion makes sharper.

The recursion of least squares in information form (Kailath, Sayed & Hassibi, Linear Estimation, 2000, ch. 9): equations
of a stretch enter as their information matrix and vector, so their number does not matter. Residuals of real arms have
a memory; the information of a joint is divided by its `colour`, by how much that makes the variance of friction larger
than independent residuals would. It comes from the covariance of Newey & West of the first stretch, and is kept up.
Friction changes with temperature: it may wander by `WANDER` in `WANDER_S` of motion, and so may the torque offsets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.equations import PAYLOAD, Equations
from joint_id_core.arm.faults import Faults
from joint_id_core.arm.friction import shows_bend
from joint_id_core.arm.gear import with_yielding
from joint_id_core.arm.information import Information
from joint_id_core.data.recording import Array

WANDER, WANDER_S = 0.05, 600.0  # of the friction of a joint, its standard deviation after a time of motion in s
STRETCH_S = 4.0  # of motion, longer than what is left of a torque remembers
MEMORY_S = 300.0  # of motion, over which noise and colour are averaged
GRAVITY = 4  # parameters of a payload that gravity shows: its mass and first moments
KINDS = 3  # of friction by joint: viscous, Coulomb, its bend
UNKNOWN = 1e3  # standard deviation, in SI units, of what no motion has shown
ROUNDED = 1e-9  # share of the variance of a parameter that rounding may take from it


@dataclass(frozen=True)
class Scores:
    """Sums over a stretch of motion, by joint and column: what is left of the torque times the column, and its square.

    Without a memory of what is left, the mean of the first squared is sigma^2 times the second. Columns are those of
    friction, and of mass and first moments of a payload, which gravity shows; shapes (n, k); `duration` in s of motion.
    """

    products: Array
    squares: Array
    duration: float = 0.0

    @classmethod
    def none(cls, count: int, columns: int) -> Scores:
        """Return sums over nothing."""
        return cls(np.zeros((count, columns)), np.zeros((count, columns)))

    def colour(self, sigma: Array) -> Array:
        """Return how much wider these sums scatter than without a memory, shape (n,); NaN for a joint that rests."""
        white = self.squares * sigma[:, None] ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios = np.where(white > 0.0, self.products**2 / white, 0.0).sum(axis=1)
            return np.asarray(ratios / np.count_nonzero(white > 0.0, axis=1))


@dataclass(frozen=True)
class Belief:
    """Values and covariance of P parameters: those of `Equations`, and a torque offset of each joint.

    Attributes:
        values, covariance: shapes (P,), (P, P). Those of the payload are 0 while it carries none.
        base: number of base parameters, which come first; those of the payload follow, then friction, then offsets.
        sigma: standard deviation of what is left of the torque of each joint in Nm, shape (n,).
        colour: by how much its memory makes the variance of friction larger, shape (n,), at least 1.
        mean, torque: mean and variance of the torque of each joint, in Nm and Nm^2, shape (n,).
        carries: whether the payload counts.
        seen: whether motion has shown each parameter, shape (P,): of a bend of friction, motion that was fast enough.
        duration: motion in s.
        scores: of the newest motion, for the colour.
        drift: of viscous and Coulomb friction from one stretch to the next, as a share of it, (2,): see `drift`.
        faults: of the samples from which it was learnt.
    """

    values: Array
    covariance: Array
    base: int
    sigma: Array
    colour: Array
    mean: Array
    torque: Array
    carries: bool
    seen: NDArray[np.bool_]
    duration: float
    scores: Scores
    drift: Array
    faults: Faults

    @property
    def count(self) -> int:
        """Number of joints."""
        return len(self.sigma)

    @property
    def payload(self) -> slice:
        """Place of the parameters of the payload."""
        return slice(self.base, self.base + PAYLOAD)

    @property
    def offsets(self) -> slice:
        """Place of the torque offsets."""
        return slice(len(self.values) - self.count, len(self.values))

    @property
    def friction(self) -> slice:
        """Place of the parameters of friction."""
        return slice(self.base + PAYLOAD, len(self.values) - self.count)

    @property
    def gears(self) -> NDArray[np.intp]:
        """Places of the parameters of gears that yield, (2 n,): see `gear`."""
        return self.friction.start + np.arange(KINDS * self.count, (KINDS + 2) * self.count)

    @property
    def told_covariance(self) -> Array:
        """The covariance (P, P) with what gears may do otherwise than straight springs, and what faults may do.

        More motion does not tell these better: it has them, too (`with_faults`).
        """
        return with_yielding(self.values, self.covariance, self.gears) + np.outer(self.faults.shift, self.faults.shift)

    def friction_of(self, joint: int) -> NDArray[np.intp]:
        """Return the places of the parameters of friction of a joint."""
        return self.friction.start + joint + self.count * np.arange(KINDS)

    @property
    def friction_scale(self) -> Array:
        """Size of each kind of friction of each joint, (KINDS, n): viscous, Coulomb, and the latter of its bend."""
        viscous, coulomb = np.abs(self.values[self.friction][: 2 * self.count]).reshape(2, -1)
        return np.array([viscous, coulomb, coulomb])

    def scores_of(self, joint: int) -> list[int]:
        """Return the places of the columns of a joint whose scores tell the colour."""
        return [*self.friction_of(joint).tolist(), *range(self.base, self.base + GRAVITY)]

    @property
    def r_squared(self) -> Array:
        """Share of the torque of each joint that is explained, shape (n,); NaN where none was seen."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.torque > 0.0, 1.0 - self.sigma**2 / self.torque, np.nan)

    def information(self, parts: Sequence[Equations]) -> Information:
        """Return what the equations of some stretches say."""
        size = len(self.values)
        matrix, vector, energy = np.zeros((size, size)), np.zeros(size), 0.0
        for part in parts:
            for j in range(self.count):
                columns, left = self._of_joint(part, j)
                weight = 1.0 / (self.sigma[j] ** 2 * self.colour[j])
                matrix += weight * columns.T @ columns
                vector += weight * columns.T @ left
                energy += weight * float(left @ left)
        return Information(self.values, matrix, vector, energy)

    def evidence(self, told: Information) -> float:
        """Return twice the logarithm of the likelihood of equations, but for what all beliefs share."""
        beside, root = told.beside(self.values), self._root()
        lower = np.linalg.cholesky(np.eye(root.shape[1]) + root.T @ beside.matrix @ root)
        pull = np.linalg.solve(lower, root.T @ beside.vector)
        return float(pull @ pull - 2.0 * np.log(np.diag(lower)).sum()) - beside.energy

    def told(self, information: Information) -> Belief:
        """Return the belief after equations."""
        beside, root = information.beside(self.values), self._root()
        inner = np.linalg.inv(np.eye(root.shape[1]) + root.T @ beside.matrix @ root)
        covariance = root @ inner @ root.T
        values = self.values + covariance @ beside.vector
        return replace(self, values=values, covariance=0.5 * (covariance + covariance.T))

    def after(self, part: Equations) -> Belief:
        """Return the belief after a stretch of motion, with noise and colour kept up."""
        if not part.used.any():
            return self
        found = self._wandered(part.duration).told(self.information([part]))
        share, seen = min(1.0, part.duration / MEMORY_S), self.seen.copy()
        sigma, mean, torque = (a.copy() for a in (self.sigma, self.mean, self.torque))
        scores = Scores(self.scores.products.copy(), self.scores.squares.copy(), self.scores.duration + part.duration)
        quick = shows_bend(part)
        for j in range(self.count):
            columns, left = found._of_joint(part, j)
            if not len(left):
                continue
            shown_now = np.any(columns != 0.0, axis=0)
            shown_now[self.friction_of(j)[2]] &= quick[j]
            seen |= shown_now
            sigma[j] = np.sqrt(sigma[j] ** 2 + share * float(np.mean(left**2) - sigma[j] ** 2))
            y = part.y[part.used[:, j], j]
            mean[j] += share * float(np.mean(y - mean[j]))
            torque[j] += share * float(np.mean((y - mean[j]) ** 2) - torque[j])
            shown = columns[:, self.scores_of(j)]
            scores.products[j] += shown.T @ left
            scores.squares[j] += np.sum(shown**2, axis=0)
        duration = self.duration + part.duration
        found = replace(found, sigma=sigma, mean=mean, torque=torque, seen=seen, duration=duration, scores=scores)
        return found._with_colour()

    def with_faults(self, before: Belief, part: Equations, torque: Array) -> Belief:
        """Return this belief, which is that `before` after a stretch, with what faults did in it to the values.

        Values are linear in torques. So what faults add to these, (R, n), moves them by the same recursion: faults are
        considered, and not estimated (Schmidt, Advances in Control Systems 3, 1966).
        """
        moved = replace(before, values=before.faults.shift).information([replace(part, y=torque)])
        shift = before.faults.shift + self.covariance @ moved.vector
        return replace(self, faults=replace(before.faults, shift=shift))

    def _with_colour(self) -> Belief:
        """Return the belief with the colour of the newest motion, if there is enough of it."""
        if self.scores.duration < STRETCH_S:
            return self
        new = self.scores.colour(self.sigma)
        share = min(1.0, self.scores.duration / MEMORY_S)
        mixed = np.where(np.isfinite(new), self.colour + share * (new - self.colour), self.colour)
        return replace(self, colour=np.maximum(1.0, mixed), scores=Scores.none(*self.scores.products.shape))

    def left(self, parts: Sequence[Equations]) -> Array:
        """Return the mean square of what is left of the torque of each joint over its variance, shape (n,).

        The variance is that of noise and of the values: a young belief does not know all poses.
        """
        found, root = np.zeros(self.count), self._root()
        for j in range(self.count):
            rows = [self._of_joint(part, j) for part in parts]
            left = np.concatenate([row[1] for row in rows])
            if len(left):
                doubt = np.concatenate([row[0] for row in rows]) @ root
                found[j] = float(np.mean(left**2)) / (self.sigma[j] ** 2 + float(np.mean(np.sum(doubt**2, axis=1))))
        return found

    def widened(self, places: NDArray[np.intp] | slice, sigma: Array) -> Belief:
        """Return the belief with parameters that may have changed by a standard deviation, shape (k,)."""
        covariance = self.covariance.copy()
        index = np.arange(len(self.values))[places]
        covariance[index, index] += sigma**2
        return replace(self, covariance=covariance)

    def with_payload(self, sigma: Array | None) -> Belief:
        """Return the belief with a payload of which only a standard deviation (10,) is known; None: it carries none."""
        values, covariance, shift = self.values.copy(), self.covariance.copy(), self.faults.shift.copy()
        place = self.payload
        values[place], shift[place], covariance[place], covariance[:, place] = 0.0, 0.0, 0.0, 0.0
        if sigma is not None:
            covariance[place, place] = np.diag(sigma**2)
        faults, carries = replace(self.faults, shift=shift), sigma is not None
        return replace(self, values=values, covariance=covariance, faults=faults, carries=carries)

    def _of_joint(self, part: Equations, j: int) -> tuple[Array, Array]:
        """Return the columns (R, P) of the equations of a joint, and what is left of its torque (R,)."""
        used = part.used[:, j]
        columns = np.concatenate([part.columns[used, j], np.zeros((np.count_nonzero(used), self.count))], axis=1)
        columns[:, self.offsets.start + j] = 1.0
        return columns, part.y[used, j] - columns @ self.values

    def _wandered(self, duration: float) -> Belief:
        """Return the belief after some seconds of motion in which friction and offsets may have changed."""
        covariance = self.covariance.copy()
        share = WANDER * np.sqrt(duration / WANDER_S)
        size = np.zeros(len(self.values))
        scale = share * self.friction_scale
        size[self.friction.start : self.friction.start + scale.size] = scale.ravel()
        size[self.offsets] = scale[1]
        covariance[np.diag_indices_from(covariance)] += size**2
        return replace(self, covariance=covariance)

    def _root(self) -> Array:
        """Return a square root (P, k) of the covariance, without the payload if there is none."""
        index = np.arange(len(self.values))
        active = index if self.carries else np.delete(index, self.payload)
        size = np.sqrt(np.diag(self.covariance)[active])
        size = np.where(size > 0.0, size, 1.0)
        scaled = self.covariance[np.ix_(active, active)] / np.outer(size, size)
        root = np.zeros((len(index), len(active)))
        root[active] = size[:, None] * np.linalg.cholesky(scaled + ROUNDED * np.eye(len(active)))
        return root
