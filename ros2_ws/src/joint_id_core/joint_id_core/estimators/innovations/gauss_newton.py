"""Gauss-Newton with Levenberg damping on the innovations cost (Nocedal & Wright, ch. 10)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.noise import NoiseScoring
from joint_id_core.estimators.innovations.recursion import Pass, Recursion

NEARLY = 1.0  # squared length in standard deviations of a last step at which an iteration may be cut off
SMALLEST_SHARE = 0.02  # of a step of the noise levels
STRONG_DAMPING = 0.1  # from which a short step does not mean that the solution is near
NEGLIGIBLE = 0.01  # squared length of such a step at which the iteration is given up
MAX_STEP = 1.0  # a factor e in a positive parameter; keeps the first steps inside the model's validity


@dataclass(frozen=True)
class Minimum:
    """Where the iteration ended: coordinates and noise levels; the last pass, matrix, gradient and cost with the prior.

    `substeps` are the integrator's steps a sample where nothing asks for more: `last.steps` has those of each sample.
    `settled` says whether the last step was short enough, or nearly so; `integration` is what the coordinates moved
    when the step of the integrator was halved last. `left` is not zero where the iteration stalled: there the way to
    the solution of the estimating equation leads uphill, since the likelihood also knows the derivative of the gain. In
    a right model the two agree; in a wrong one their distance says how far estimates are uncertain for it.
    """

    z: Array
    levels: Array
    last: Pass
    hessian: Array
    gradient: Array
    cost: float
    substeps: int
    settled: bool
    iterations: int
    integration: Array
    left: Array

    @cached_property
    def inverse(self) -> Array:
        """Of the matrix, shape (k, k): the covariance that the noise leaves to the coordinates."""
        return np.asarray(np.linalg.inv(self.hessian), dtype=float)

    @property
    def distance_left(self) -> float:
        """Length of the way that is left, in standard deviations."""
        return float(np.sqrt(self.left @ self.hessian @ self.left)) if self.left.any() else 0.0

    @property
    def covariance(self) -> Array:
        """Of the coordinates, shape (k, k): of the noise, the squares of the integration error and of what is left."""
        errors = np.outer(self.integration, self.integration) + np.outer(self.left, self.left)
        return np.asarray(self.inverse + errors, dtype=float)


@dataclass(frozen=True)
class Cost:
    """What is minimised: the innovations cost of a record, and the distance from a prior, by estimation coordinates."""

    recursion: Recursion
    coordinates: Coordinates
    belief: Belief

    def values(self, z: Array) -> Array:
        """All parameter values at z."""
        return self.recursion.values(self.coordinates.values(z))

    def at(self, z: Array, levels: Array, steps: Steps, substeps: int) -> Minimum | None:
        """One pass at z with `steps` (T,) and `substeps` as in `Minimum`; None when its cost is not finite."""
        values = self.coordinates.values(z)
        last = self.recursion.run(values, levels, steps)
        d = z - self.belief.mean
        pull = self.belief.precision @ d
        cost = last.cost + float(d @ pull)
        if not np.isfinite(cost):
            return None
        slope, none = np.where(self.coordinates.positive, values, 1.0), np.zeros_like(z)
        hessian = last.hessian * (slope[:, None] * slope) + self.belief.precision
        return Minimum(z, levels, last, hessian, last.gradient * slope - pull, cost, substeps, False, 0, none, none)


def minimise(
    cost: Cost, start: Minimum | None, tolerance: float, max_iterations: int, noise: NoiseScoring | None = None
) -> Minimum | None:
    """Minimise the cost from `start`, with its steps, and with the noise levels where `noise` is given.

    Stops when the step to take, squared in standard deviations (the Newton decrement dz' H dz, and that of the noise
    levels), is below `tolerance`, or when the score of the noise levels leads no further: it leaves out that the
    linearisation depends on them. Where these are fitted, the last step is taken without a pass of its own. The
    derivative of the gain is left out of the gradient, so close to the solution the cost may rise by a little along a
    correct step: steps with a decrement below 1 are taken as they are.

    Returns:
        The minimum, or None when there was no start.
    """
    if start is None:
        return None
    here, coordinates = start, cost.coordinates
    damping, share, settled, iterations = 1e-3, 1.0, False, 0
    push, noise_decrement = np.zeros_like(here.levels), np.inf if noise else 0.0
    moved = True
    while iterations < max_iterations:
        if noise is not None and moved and noise_decrement >= 0.1 * tolerance:  # else they have settled
            before = push
            push, noise_decrement = noise.step(here.last)
            # the mean information may be less than the curvature: steps that go to and fro are too long
            share = 0.5 * share if push @ before < -0.25 * before @ before else min(1.0, 1.5 * share)
        z, H, g = here.z, here.hessian, here.gradient
        damped = H.copy()
        damped.flat[:: len(z) + 1] *= 1.0 + damping
        dz = newton_step(damped, g, coordinates.held(z, g))
        decrement = float(dz @ H @ dz)
        levels = here.levels * np.exp(share * push)
        free_step = damping <= STRONG_DAMPING
        enough = tolerance if free_step else NEGLIGIBLE
        settled = decrement < max(enough, NEARLY)
        if decrement < enough and (noise_decrement < enough or share < SMALLEST_SHARE):
            if free_step and noise is not None:  # with rough noise levels it would lead back to the prior
                here = replace(here, z=coordinates.clip(z + dz), levels=levels)
            break
        iterations += 1
        longest = float(np.max(np.abs(dz) / coordinates.unit))
        if longest > MAX_STEP:
            dz *= MAX_STEP / longest
        there = cost.at(coordinates.clip(z + dz), levels, start.last.steps, start.substeps)
        small = decrement + noise_decrement < 1.0
        moved = there is not None and (there.cost < here.cost or (small and there.cost < here.cost + 1.0))
        if moved:
            assert there is not None
            here, damping = there, max(damping / 10.0, 1e-12)
        else:
            damping, share = max(damping, 1e-6) * 10.0, 0.5 * share
            if damping > 1e8:
                break
    left = np.zeros_like(here.z)
    if damping > STRONG_DAMPING:  # the steps became short because the cost rose along them
        left = way_left(here, coordinates)
    return replace(here, settled=settled, iterations=iterations, left=left)


def newton_step(matrix: Array, gradient: Array, held: NDArray[np.bool_]) -> Array:
    """The step of the coordinates that are not `held`."""
    if not held.any():
        return np.asarray(np.linalg.solve(matrix, gradient), dtype=float)
    step, active = np.zeros_like(gradient), ~held
    step[active] = np.linalg.solve(matrix[np.ix_(active, active)], gradient[active])
    return step


def way_left(here: Minimum, coordinates: Coordinates) -> Array:
    """From here to the solution of the estimating equation, as far as one step shows it."""
    full = newton_step(here.hessian, here.gradient, coordinates.held(here.z, here.gradient))
    return np.clip(full, -MAX_STEP, MAX_STEP)
