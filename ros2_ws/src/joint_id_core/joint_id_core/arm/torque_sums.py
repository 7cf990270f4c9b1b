"""How well the torques of an arm are explained if they act otherwise than they were recorded.

What a fit needs of its equations are sums: of products of columns, of columns with torques, and of torques. They are
the same whichever torque is taken for that of a joint, and whatever its size. So many guesses cost little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from joint_id_core.arm.beforehand import Beforehand
from joint_id_core.arm.equations import SLOW, Equations
from joint_id_core.arm.regressor import Regressor
from joint_id_core.arm.stacked import centred
from joint_id_core.data.recording import Array

WEIGHINGS, SAME = 20, 0.02  # passes that weigh the joints at most, and change of a logarithm that ends them
ROUNDED = 1e-12  # of scaled normal equations
ALL = -1  # joints
INSTANTS = 400  # of all recordings
DOUBTED = 1e6  # times the variance with which a torque that is doubted begins
LEAST = 1e-12  # of the squares of a torque, what rounding leaves


@dataclass(frozen=True)
class Guess:
    """How the torques of n joints act.

    Attributes:
        column: number of the joint as whose torque that of each was recorded, (n,).
        factor: on it, (n,).
    """

    column: NDArray[np.intp]
    factor: Array

    @classmethod
    def as_recorded(cls, count: int) -> Guess:
        """Return that they are what was recorded."""
        return cls(np.arange(count), np.ones(count))

    def scaled(self, joint: int, factor: float) -> Guess:
        """Return that that of a joint, or of all of them (`ALL`), is so many times as large."""
        changed = self.factor.copy()
        changed[slice(None) if joint == ALL else joint] *= factor
        return replace(self, factor=changed)

    def exchanged(self, one: int, other: int) -> Guess:
        """Return that those of two joints are in the columns of each other."""
        changed = self.column.copy()
        changed[[one, other]] = changed[[other, one]]
        return replace(self, column=changed)


@dataclass(frozen=True)
class Moved:
    """The motion of n joints at T instants, and their torques.

    Attributes:
        q, dq, ddq: positions in rad, velocities in rad/s and accelerations in rad/s^2, (T, n).
        torque: in Nm, (T, n).
        used: whether a joint moves steadily, (T, n).
        piece: number of the recording, (T,).
    """

    q: Array
    dq: Array
    ddq: Array
    torque: Array
    used: NDArray[np.bool_]
    piece: NDArray[np.intp]

    @classmethod
    def of(cls, parts: Sequence[Equations]) -> Moved:
        """Return instants of recordings at which the torques of all joints are known, `INSTANTS` at most."""
        pieces = list[Moved]()
        for k, part in enumerate(parts):
            known = np.isfinite(np.concatenate([part.q, part.dq, part.ddq, part.y], axis=1)).all(axis=1)
            rows = np.flatnonzero(known & part.used.any(axis=1))
            most = max(2, INSTANTS // len(parts))
            if len(rows) > most:
                rows = rows[np.linspace(0, len(rows) - 1, most).astype(np.intp)]
            q, dq, ddq, torque = (values[rows] for values in (part.q, part.dq, part.ddq, part.y))
            pieces.append(cls(q, dq, ddq, torque, part.used[rows], np.full(len(rows), k)))
        return cls(*(np.concatenate([getattr(piece, one.name) for piece in pieces]) for one in fields(cls)))

    def thinned(self, every: int) -> Moved:
        """Return one of so many instants."""
        return Moved(*(getattr(self, part.name)[::every] for part in fields(self)))

    def scaled(self, joint: int, factor: float) -> Moved:
        """Return the motion with the position of a joint so many times as large."""
        factors = np.where(np.arange(self.q.shape[1]) == joint, factor, 1.0)
        return replace(self, q=self.q * factors, dq=self.dq * factors, ddq=self.ddq * factors)

    def shifted(self, joint: int, angle: float) -> Moved:
        """Return the motion with the position of a joint larger by an angle in rad."""
        return replace(self, q=self.q + np.where(np.arange(self.q.shape[1]) == joint, angle, 0.0))

    def exchanged(self, one: int, other: int) -> Moved:
        """Return the motion with the positions of two joints in the place of each other."""
        order = np.arange(self.q.shape[1])
        order[[one, other]] = other, one
        changed = {name: getattr(self, name)[:, order] for name in ("q", "dq", "ddq", "used")}
        return replace(self, **changed)


@dataclass(frozen=True)
class Explained:
    """What a guess leaves.

    Attributes:
        left: minus the logarithm of the likelihood: that of what is left of each torque, summed over the equations.
        r_squared: share of the torque of each joint that is explained, (n,); NaN where there are no equations.
    """

    left: float
    r_squared: Array


@dataclass(frozen=True)
class TorqueSums:
    """Sums over the equations of each of n joints, with P parameters.

    Attributes:
        matrix: of products of columns, (n, P, P).
        vector: of columns with the torque of any joint, (n, P, n).
        squares: of products of these torques, (n, n, n).
        counts: of equations, (n,).
        precision, expected: see `Stacked`; (P, P) and (P,).
    """

    matrix: Array
    vector: Array
    squares: Array
    counts: NDArray[np.intp]
    precision: Array
    expected: Array

    @classmethod
    def of(cls, regressor: Regressor, moved: Moved, beforehand: Beforehand) -> TorqueSums:
        """Return the sums for joints that move as guessed.

        Args:
            regressor: of the arm.
            moved: its motion, and the torques.
            beforehand: what is known of its links.
        """
        count, matrix, vector, squares, counts = len(regressor.joints), [], [], [], []
        inertial = regressor.rows(moved.q, moved.dq, moved.ddq)[0]
        own = np.eye(count)
        more = np.concatenate([moved.dq[:, :, None] * own, np.tanh(moved.dq / SLOW)[:, :, None] * own], axis=2)
        columns = np.concatenate([inertial, more], axis=2)
        for j in range(count):
            used = moved.used[:, j]
            pieces = [np.flatnonzero(used & (moved.piece == k)) for k in np.unique(moved.piece)]
            rows = np.concatenate([centred(columns[piece, j]) for piece in pieces])
            torques = np.concatenate([centred(moved.torque[piece]) for piece in pieces])
            matrix.append(rows.T @ rows)
            vector.append(rows.T @ torques)
            squares.append(torques.T @ torques)
            counts.append(len(rows))
        size = columns.shape[2]
        known = beforehand.precision(size), beforehand.of_all(size)
        return cls(np.array(matrix), np.array(vector), np.array(squares), np.array(counts), *known)

    def explained(self, guess: Guess, doubted: int = ALL) -> Explained:
        """Return what is left if the torques act as guessed; that of a joint that alone is doubted counts little first.

        Its neighbours then tell what links they share: else it may keep those away from what explains all.
        """
        own = np.arange(len(self.counts))
        whole = guess.factor**2 * self.squares[own, guess.column, guess.column]
        products = guess.factor[:, None] * self.vector[own, :, guess.column]
        counts = np.maximum(self.counts, 1)
        variance = np.where(whole > 0.0, whole / counts, 1.0)
        least = LEAST * variance
        variance = np.where(own == doubted, DOUBTED * variance, variance)
        for _ in range(WEIGHINGS):
            values = self._solved(products, variance)
            left = whole - 2.0 * products @ values + np.einsum("p,jpq,q->j", values, self.matrix, values)
            before, variance = variance, np.maximum(left / counts, least)
            if np.all(np.abs(np.log(variance / before)) < SAME):
                break
        with np.errstate(invalid="ignore", divide="ignore"):
            r_squared = np.where(whole > 0.0, 1.0 - left / whole, np.nan)
        # The likelihood is that of what was recorded: a torque that is guessed to be smaller has less to be explained.
        return Explained(float(self.counts @ (0.5 * np.log(variance) - np.log(np.abs(guess.factor)))), r_squared)

    def _solved(self, products: Array, variance: Array) -> Array:
        """Return the values (P,) for variances of what is left of each torque (n,)."""
        normal = np.tensordot(1.0 / variance, self.matrix, 1) + self.precision
        size = np.sqrt(np.diag(normal))
        size = np.where(size > 0.0, size, 1.0)
        vector = products.T @ (1.0 / variance) + self.precision @ self.expected
        scaled = normal / np.outer(size, size) + ROUNDED * np.eye(len(size))
        scaled[np.diag_indices_from(scaled)] += np.diag(normal) <= 0.0
        return np.asarray(np.linalg.solve(scaled, vector / size) / size)
