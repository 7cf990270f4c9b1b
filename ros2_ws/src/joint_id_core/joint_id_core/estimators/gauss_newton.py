"""Gauss-Newton with Levenberg damping on the innovations cost (Nocedal & Wright, ch. 10)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from joint_id_core.estimators.belief import Belief, Coordinates
from joint_id_core.estimators.noise import NoiseLevels
from joint_id_core.estimators.recursion import Pass, Recursion
from joint_id_core.recording import Array
from joint_id_core.rk4 import Steps

SMALLEST_SHARE = 0.02  # of a step of the noise levels
MAX_STEP = 1.0  # a factor e in a positive parameter; keeps the first steps inside the model's validity


@dataclass(frozen=True)
class Minimum:
    """Where the iteration ended: coordinates, noise levels, the pass there; matrix, gradient and cost with the prior.

    `integration` is what the coordinates moved when the step of the integrator was halved last.
    """

    z: Array
    levels: Array
    last: Pass
    hessian: Array
    gradient: Array
    cost: float
    decrement: float
    iterations: int
    integration: Array

    @property
    def covariance(self) -> Array:
        """Of the coordinates, shape (k, k): of the noise, and the square of the integration error."""
        return np.asarray(np.linalg.inv(self.hessian) + np.outer(self.integration, self.integration), dtype=float)


def evaluate(
    recursion: Recursion, coordinates: Coordinates, belief: Belief, z: Array, levels: Array, substeps: Steps
) -> Minimum | None:
    """One pass at z, with the prior; None when its cost is not finite."""
    last = recursion.run(coordinates.values(z), levels, substeps)
    cost = last.cost + belief.cost(z)
    if not np.isfinite(cost):
        return None
    slope = coordinates.slope(z)
    H = last.hessian * np.outer(slope, slope) + belief.precision
    g = last.gradient * slope - belief.precision @ (z - belief.mean)
    return Minimum(z, levels, last, H, g, cost, np.inf, 0, np.zeros_like(z))


def minimise(
    recursion: Recursion,
    coordinates: Coordinates,
    belief: Belief,
    start: Minimum | None,
    substeps: Steps,
    tolerance: float,
    max_iterations: int,
    noise: NoiseLevels | None = None,
) -> Minimum | None:
    """Minimise innovations cost plus prior from `start` (see `evaluate`), with the noise levels where `noise` is given.

    Stops when the step to take, squared in standard deviations (the Newton decrement dz' H dz, and that of the noise
    levels), is below `tolerance`, or when the score of the noise levels leads no further: it leaves out that the
    linearisation depends on them. The derivative of the gain is left out of the gradient, so close to the
    solution the cost may rise by a little along a correct step: steps with a decrement below 1 are taken as they are.

    Returns:
        The minimum, or None when there was no start.
    """
    if start is None:
        return None
    here = start
    damping, share, decrement, iterations = 1e-3, 1.0, np.inf, 0
    push, noise_decrement = np.zeros_like(here.levels), np.inf if noise else 0.0
    moved = True
    while iterations < max_iterations:
        if noise is not None and moved and noise_decrement >= 0.1 * tolerance:  # else they have settled
            before = push
            push, noise_decrement = noise.step(here.levels, *recursion.noise_information(here.last))
            # the mean information may be less than the curvature: steps that go to and fro are too long
            share = 0.5 * share if push @ before < -0.25 * before @ before else min(1.0, 1.5 * share)
        z, H, g = here.z, here.hessian, here.gradient
        active = ~(coordinates.at_bound(z) & (np.sign(g) == np.where(z >= coordinates.upper, 1.0, -1.0)))
        dz = np.zeros_like(z)
        Ha = H[np.ix_(active, active)]
        dz[active] = np.linalg.solve(Ha + damping * np.diag(np.diag(Ha)), g[active])
        decrement = float(dz @ H @ dz)
        if decrement < tolerance and (noise_decrement < tolerance or share < SMALLEST_SHARE):
            break
        iterations += 1
        longest = float(np.max(np.abs(dz) / np.where(coordinates.positive, 1.0, coordinates.spread)))
        if longest > MAX_STEP:
            dz *= MAX_STEP / longest
        levels = here.levels * np.exp(share * push)
        there = evaluate(recursion, coordinates, belief, coordinates.clip(z + dz), levels, substeps)
        small = decrement + noise_decrement < 1.0
        moved = there is not None and (there.cost < here.cost or (small and there.cost < here.cost + 1.0))
        if moved:
            assert there is not None
            here, damping = there, max(damping / 10.0, 1e-12)
        else:
            damping, share = max(damping, 1e-6) * 10.0, 0.5 * share
            if damping > 1e8:
                break
    return replace(here, decrement=decrement, iterations=iterations)
