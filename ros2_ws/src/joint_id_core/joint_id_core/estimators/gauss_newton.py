"""Gauss-Newton with Levenberg damping on the innovations cost (Nocedal & Wright, ch. 10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from joint_id_core.estimators.belief import Belief, Coordinates
from joint_id_core.estimators.recursion import Pass, Recursion
from joint_id_core.recording import Array

MAX_STEP = 1.0  # a factor e in a positive parameter; keeps the first steps inside the model's validity


@dataclass(frozen=True)
class Minimum:
    """Where the iteration ended: coordinates, the pass there, Gauss-Newton matrix, cost with prior, decrement."""

    z: Array
    last: Pass
    hessian: Array
    cost: float
    decrement: float
    iterations: int


def minimise(
    recursion: Recursion,
    coordinates: Coordinates,
    belief: Belief,
    z: Array,
    R: Array,
    q: Array,
    substeps: int,
    tolerance: float,
    max_iterations: int,
) -> Minimum | None:
    """Minimise innovations cost plus prior from z. Stops when the Newton decrement dz' H dz < tolerance.

    The derivative of the gain is left out of the gradient, so close to the solution the cost may rise by a
    little along a correct step: steps with a decrement below 1 (less than one sigma) are taken as they are.

    Returns:
        The minimum, or None when the cost at the start is not finite.
    """

    def evaluate(z: Array) -> tuple[Pass, float] | None:
        values = coordinates.values(z)
        result = recursion.run(values, R, q, substeps)
        cost = result.cost + belief.cost(z)
        return (result, cost) if np.isfinite(cost) else None

    def normal_equations(result: Pass, z: Array) -> tuple[Array, Array]:
        J = result.jacobian.reshape(-1, len(z)) * coordinates.slope(z)
        H = J.T @ J + belief.precision
        return H, J.T @ result.residuals.ravel() - belief.precision @ (z - belief.mean)

    here = evaluate(z)
    if here is None:
        return None
    result, cost = here
    damping, decrement, iterations = 1e-3, np.inf, 0
    H, g = normal_equations(result, z)
    while iterations < max_iterations:
        iterations += 1
        active = ~(coordinates.at_bound(z) & (np.sign(g) == np.where(z >= coordinates.upper, 1.0, -1.0)))
        dz = np.zeros_like(z)
        Ha = H[np.ix_(active, active)]
        dz[active] = np.linalg.solve(Ha + damping * np.diag(np.diag(Ha)), g[active])
        decrement = float(dz @ H @ dz)
        longest = float(np.max(np.abs(dz) / np.where(coordinates.positive, 1.0, coordinates.spread)))
        if longest > MAX_STEP:
            dz *= MAX_STEP / longest
        trial = coordinates.clip(z + dz)
        there = evaluate(trial)
        if there is not None and (there[1] < cost or (decrement < 1.0 and there[1] < cost + 1.0)):
            z, (result, cost) = trial, there
            H, g = normal_equations(result, z)
            damping = max(damping / 10.0, 1e-12)
            if decrement < tolerance:
                break
        else:
            damping = max(damping, 1e-6) * 10.0
            if damping > 1e8:
                break
    return Minimum(z, result, H, cost, decrement, iterations)
