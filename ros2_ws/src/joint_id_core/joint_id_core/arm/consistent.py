"""Bodies that exist and are near those of a description, with combinations of parameters that were estimated.

Least squares of the estimated combinations, weighed by their covariance, and the entropic distance of every
pseudo-inertia to that of the description,

    D(P, P0) = tr(P0^-1 P) - log det(P0^-1 P) - 4,

(Lee, Wensing & Park, IEEE Transactions on Robotics 36, 2020); and the same of the mass by itself, as masses are on data
sheets and no torque shows one alone. It keeps P positive definite, does not depend on frames
or units, and makes the problem convex: Newton's method finds the one minimum. The weight of the distance is the one
under which the estimate is the most likely (MacKay, Neural Computation 4, 1992): it says by how much bodies of this
description are wrong, as a share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # whose parts load when used

from joint_id_core.arm.pseudo_inertia import parameters_of
from joint_id_core.data.recording import Array

LEAST, MOST, RATIO = 0.01, 10.0, 1.6  # shares by which a description may be wrong, and steps between them
WORSE = 5.0  # logarithm of likelihood below the best, beyond which no share is tried
APART = 0.02  # of the logarithms of two shares that are the same
SETTLED, ROUNDED = 1e-9, 1e-12  # gain of a step in the logarithm of likelihood, or share of it, that is none
OF_MASS = 25.0  # weight of the mass by itself: it is known five times better than how it is spread
ACCURACY = 1e-4  # of combinations at best: lengths of a description have four digits
KNOWN = 1e-4  # least variance of a direction over that of single combinations: less is chance
ITERATIONS = 100
ENOUGH = 0.1  # of the gain that the slope promises, which a step must bring
CORNERS = [(i, j) for i in range(4) for j in range(i + 1)]  # a symmetric 4 by 4 matrix has ten entries
BASIS = np.array([[[float((r, c) in ((i, j), (j, i))) for c in range(4)] for r in range(4)] for i, j in CORNERS])
ROWS, COLUMNS = np.array(CORNERS).T
TWICE = np.sum(BASIS, axis=(1, 2))  # how often a matrix has each of its entries


@dataclass(frozen=True)
class Consistent:
    """Bodies and rotors near an estimate.

    Attributes:
        rotors: inertias at the link, shape (n,).
        bodies: pseudo-inertias, shape (n, 4, 4).
        distances: D of each body from that of the description, shape (n,).
        share: by which second moments of the description seem to be wrong; masses by a fifth of it.
    """

    rotors: Array
    bodies: Array
    distances: Array
    share: float


class _Point(NamedTuple):
    """Rotors that are not held, and roots of the pseudo-inertias, P = L L': P stays positive definite."""

    rotors: Array
    roots: Array


class Problem:
    """Estimated combinations of the parameters of n bodies and rotors, and a description of the bodies."""

    def __init__(self, composition: Array, values: Array, covariance: Array, rotors: Array, described: Array) -> None:
        """Take an estimate.

        Args:
            composition: of the combinations, of rotors and of ten parameters of each body, shape (B, 11 n).
            values, covariance: of the combinations, shapes (B,) and (B, B); no variance is 0.
            rotors: inertias of the rotors by the estimate; those that are 0 are held, shape (n,).
            described: pseudo-inertias, positive definite, shape (n, 4, 4).
        """
        n = len(rotors)
        self._rotors, self._turning = rotors, np.flatnonzero(rotors > 0.0)
        self._described, self._inverse = described, np.linalg.inv(described)
        least = ACCURACY * np.abs(values)
        covariance = covariance + np.diag(least**2)
        sigma = np.sqrt(np.diag(covariance))
        sizes, axes = np.linalg.eigh(covariance / np.outer(sigma, sigma))
        whiten = (axes / np.sqrt(np.maximum(sizes, KNOWN))).T / sigma
        entries = np.array([parameters_of(step) for step in BASIS])
        by_entry = np.einsum("bnp,kp->bnk", composition[:, n:].reshape(-1, n, 10), entries)
        self._of_rotors, self._target = whiten @ composition[:, self._turning], whiten @ values
        self._of_bodies = np.einsum("rb,bnk,kij->rnij", whiten, by_entry / TWICE, BASIS)

    def solved(self) -> Consistent:
        """Return the bodies with the most likely weight of the distance."""
        share, point = self._likely()
        rotors = self._rotors.copy()
        rotors[self._turning] = point.rotors
        return Consistent(rotors, _squared(point.roots), self._apart(point.roots), share)

    def _likely(self) -> tuple[float, _Point]:
        """Return the most likely share by which the description is wrong, and the minimum with it.

        Shares grow from one that holds the description: from a minimum to the next one Newton's method takes few steps.
        """
        point = _Point(self._rotors[self._turning], np.asarray(np.linalg.cholesky(self._described)))
        tried: list[tuple[float, float, _Point]] = []
        share, best = LEAST, 0
        while share < MOST and (not tried or tried[-1][0] < tried[best][0] + WORSE):
            point, settled = self._nearest(point, share)
            tried.append((self._surprise(point, share), share, point))
            best = best if tried[best][0] <= tried[-1][0] else len(tried) - 1
            share *= RATIO
            if not settled:
                break  # far from all bodies: a looser weight would only lead to stranger ones
        _, below, start = tried[max(best - 1, 0)]
        _, above, _ = tried[min(best + 1, len(tried) - 1)]

        def surprise(size: float) -> float:
            return self._surprise(self._nearest(start, float(np.exp(size)))[0], float(np.exp(size)))

        found = scipy.optimize.minimize_scalar(
            surprise, bounds=(np.log(below), np.log(above)), method="bounded", options={"xatol": APART}
        )
        share = float(np.exp(found.x))
        return share, self._nearest(start, share)[0]

    def _left(self, point: _Point) -> Array:
        """Return the estimate less the combinations that bodies have, in standard deviations, with the sign turned."""
        bodies = self._of_bodies.reshape(len(self._target), -1) @ _squared(point.roots).ravel()
        return np.asarray(self._of_rotors @ point.rotors + bodies - self._target)

    def _slope(self, point: _Point) -> Array:
        """Return the change of `_left` by relative changes of rotors, and by E where P = L (1 + E) L', shape (R, K)."""
        moved = point.roots.transpose(0, 2, 1) @ self._of_bodies @ point.roots
        bodies = (moved[:, :, ROWS, COLUMNS] * TWICE).reshape(len(self._target), -1)
        return np.concatenate([self._of_rotors * point.rotors, bodies], axis=1)

    def _apart(self, roots: Array) -> Array:
        """Return the distance of bodies from the description, without that of their masses, shape (n,)."""
        inside = np.sum(self._inverse * _squared(roots), axis=(1, 2))
        sizes = 2.0 * np.log(np.abs(np.linalg.det(roots))) - np.linalg.slogdet(self._described)[1]
        return np.asarray(inside - sizes - 4.0)

    def _cost(self, point: _Point, share: float) -> float:
        """Return minus the logarithm of the likelihood of bodies and rotors."""
        left, turning = self._left(point), point.rotors / self._rotors[self._turning]
        masses = _squared(point.roots)[:, 3, 3] / self._described[:, 3, 3]
        bodies = self._apart(point.roots) + OF_MASS * (masses - np.log(masses) - 1.0)
        return float(0.5 * left @ left + np.sum(turning - np.log(turning) - 1.0) + np.sum(bodies) / share**2)

    def _bent(self, point: _Point, share: float) -> tuple[Array, Array]:
        """Return gradient (K,) and second derivatives (K, K) of what `_cost` adds to the squares."""
        count, n = len(self._turning), len(point.roots)
        gradient, second = np.empty(count + 10 * n), np.eye(count + 10 * n)
        gradient[:count] = point.rotors / self._rotors[self._turning] - 1.0
        inside = point.roots.transpose(0, 2, 1) @ self._inverse @ point.roots - np.eye(4)
        masses = np.sum(point.roots[:, 3] ** 2, axis=1)
        own = TWICE * point.roots[:, 3, ROWS] * point.roots[:, 3, COLUMNS] / masses[:, None]
        more = OF_MASS * (masses / self._described[:, 3, 3] - 1.0)
        gradient[count:] = (TWICE * inside[:, ROWS, COLUMNS] + more[:, None] * own).ravel() / share**2
        for k in range(n):
            place = slice(count + 10 * k, count + 10 * k + 10)
            second[place, place] = (np.diag(TWICE) + OF_MASS * np.outer(own[k], own[k])) / share**2
        return gradient, second

    def _nearest(self, point: _Point, share: float) -> tuple[_Point, bool]:
        """Return the minimum for one weight, from a start, and whether it was reached."""
        cost = self._cost(point, share)
        for _ in range(ITERATIONS):
            slope, (gradient, second) = self._slope(point), self._bent(point, share)
            gradient = gradient + slope.T @ self._left(point)
            step = -np.asarray(np.linalg.solve(slope.T @ slope + second, gradient))
            gain, settled, size = -float(gradient @ step), SETTLED + ROUNDED * cost, 1.0
            while size * gain > settled:
                reached = self._moved(point, size * step)
                if (less := self._cost(reached, share)) < cost - ENOUGH * size * gain:
                    break
                size *= 0.5
            else:
                return point, True
            point, cost = reached, less
        return point, False

    def _moved(self, point: _Point, step: Array) -> _Point:
        """Return the point after a step as those of `_slope`, cut short before a rotor or body is none."""
        count = len(self._turning)
        changes = np.einsum("nk,kij->nij", step[count:].reshape(-1, 10), BASIS)
        lowest = min(step[:count].min(initial=0.0), float(np.linalg.eigvalsh(changes).min()))
        size = min(1.0, 0.9 / -lowest) if lowest < 0.0 else 1.0
        roots = point.roots @ np.linalg.cholesky(np.eye(4) + size * changes)
        return _Point(point.rotors * (1.0 + size * step[:count]), roots)

    def _surprise(self, point: _Point, share: float) -> float:
        """Return minus the logarithm of the likelihood of the estimate, over all bodies (Laplace's approximation)."""
        slope, (_, second) = self._slope(point), self._bent(point, share)
        widths = np.linalg.slogdet(slope.T @ slope + second)[1] - np.linalg.slogdet(second)[1]
        return self._cost(point, share) + 0.5 * float(widths)


def _squared(roots: Array) -> Array:
    """Return L L' of roots (n, 4, 4)."""
    return np.asarray(roots @ roots.transpose(0, 2, 1))
