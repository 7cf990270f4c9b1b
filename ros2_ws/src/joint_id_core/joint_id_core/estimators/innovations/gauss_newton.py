"""Gauss-Newton with Levenberg damping on the innovations cost (Nocedal & Wright, ch. 10)."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.belief import Belief, Coordinates
from joint_id_core.estimators.innovations.noise import NoiseScoring
from joint_id_core.estimators.innovations.recursion import Pass, Recursion

NEARLY = 1.0  # squared length of the last step, in standard deviations, up to which an unfinished iteration is accepted
SMALLEST_SHARE = 0.02  # fraction of a noise-level step below which the noise levels count as settled
STRONG_DAMPING = 0.1  # above this damping a short step does not mean that the solution is near
NEGLIGIBLE = 0.01  # squared length of a step with strong damping at which the iteration ends
MAX_STEP = 1.0  # a factor e in a positive parameter; keeps the first steps inside the model's validity


@dataclass(frozen=True)
class Minimum:
    """The point where an iteration ended.

    The iteration follows the estimating equation, which neglects the derivative of the gain. The likelihood contains
    it. So the cost may rise on the way to the solution of the estimating equation, and the iteration stalls. In a
    correct model the solutions of both agree. In a wrong model their distance shows how uncertain the estimates are.

    Attributes:
        z: coordinates, shape (k,).
        levels: noise variances, shape (L,).
        last: the last pass.
        hessian, gradient, cost: Gauss-Newton matrix (k, k), gradient (k,) and cost, all with the prior.
        substeps: integrator steps per sample where no more are needed; `last.steps` has the steps of each sample.
        settled: whether the last step was short enough, or nearly so.
        iterations: number of iterations.
        integration: shift of the coordinates when the integrator's step was halved last, shape (k,).
        left: step that is left to the solution of the estimating equation, shape (k,); zero if the iteration did not
            stall.
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

    @property
    def definite(self) -> bool:
        """Whether the Gauss-Newton matrix has an inverse: it has none where rounding hides what the data say."""
        size = np.sqrt(np.maximum(np.diag(self.hessian), np.finfo(float).tiny))
        try:
            np.linalg.cholesky(self.hessian / np.outer(size, size))
            np.linalg.cholesky(self.hessian)
        except np.linalg.LinAlgError:
            return False
        return True

    @cached_property
    def inverse(self) -> Array:
        """Inverse of the Gauss-Newton matrix, shape (k, k): covariance of the coordinates due to noise."""
        return np.asarray(np.linalg.inv(self.hessian), dtype=float)

    @property
    def distance_left(self) -> float:
        """Length of the step that is left, in standard deviations."""
        return float(np.sqrt(self.left @ self.hessian @ self.left)) if self.left.any() else 0.0

    @property
    def covariance(self) -> Array:
        """Covariance of the coordinates, shape (k, k): noise, plus the squares of `integration` and `left`."""
        errors = np.outer(self.integration, self.integration) + np.outer(self.left, self.left)
        return np.asarray(self.inverse + errors, dtype=float)


@dataclass(frozen=True)
class Cost:
    """The cost to minimise: innovations cost of a record plus squared distance from a prior, as a function of z."""

    recursion: Recursion
    coordinates: Coordinates
    belief: Belief

    def values(self, z: Array) -> Array:
        """Return all parameter values at z, shape (P,)."""
        return self.recursion.values(self.coordinates.values(z))

    def at(self, z: Array, levels: Array, steps: Steps, substeps: int) -> Minimum | None:
        """Run one pass at z with `steps` (T,) and `substeps` as in `Minimum`; return None if its cost is not finite."""
        return self.after(z, self.recursion.run(self.coordinates.values(z), levels, steps), substeps)

    def after(self, z: Array, last: Pass, substeps: int) -> Minimum | None:
        """Return the point z of which `last` is the pass, with the prior; None if its cost is not finite."""
        slope, belief = self.coordinates.slope_at(last.free), self.belief
        hessian, gradient, none = np.empty_like(last.hessian), np.empty(len(z)), np.zeros(len(z))
        cost = last.cost + self.recursion.kernel.gains.with_prior(
            last.hessian, last.gradient, slope, z, belief.mean, belief.precision, hessian, gradient
        )
        if not math.isfinite(cost):
            return None
        return Minimum(z, last.levels, last, hessian, gradient, cost, substeps, False, 0, none, none)

    def step(self, here: Minimum, damping: float) -> tuple[Array, Array, float]:
        """Return the damped Newton step (k,), the point that it leads to (k,), and its squared length.

        The length is in standard deviations. The point is within the bounds, and at most `MAX_STEP` away.
        """
        at, step, there = self.coordinates, np.empty_like(here.z), np.empty_like(here.z)
        decrement = self.recursion.kernel.gains.damped_step(
            here.hessian, here.gradient, here.z, at.lower, at.upper, at.unit, damping, MAX_STEP, step, there
        )
        return step, there, float(decrement)


# Yields z and noise levels of a pass, takes the point there, returns the minimum.
Iteration = Generator[tuple[Array, Array], Minimum | None, Minimum]


def minimise(
    cost: Cost, start: Minimum | None, tolerance: float, max_iterations: int, noise: NoiseScoring | None = None
) -> Minimum | None:
    """Minimise the cost from `start` with its integrator steps; with `noise`, fit the noise levels as well.

    The iteration stops when the squared length of the next step in standard deviations is below `tolerance`. This is
    the Newton decrement dz' H dz of the parameters, and the same of the noise levels. The noise levels also count as
    settled when only a small fraction of their step is still taken (`SMALLEST_SHARE`): their score neglects that the
    linearisation depends on them. With `noise`, the last step is taken without another pass.

    The gradient neglects the derivative of the gain. So close to the solution the cost may rise slightly along a
    correct step: a step with a decrement below 1 is accepted if the cost rises by less than 1.

    Returns:
        The minimum; None if `start` is None.
    """
    if start is None:
        return None
    search = iterations(cost, start, tolerance, max_iterations, noise)
    try:
        z, levels = next(search)
        while True:
            z, levels = search.send(cost.at(z, levels, start.last.steps, start.substeps))
    except StopIteration as end:
        found: Minimum = end.value
        return found


def iterations(
    cost: Cost, start: Minimum, tolerance: float, max_iterations: int, noise: NoiseScoring | None = None
) -> Iteration:
    """Iterate as `minimise` does, and let the caller run the passes, so that many searches can share one.

    It yields the point z (k,) and the levels (L,) of the next pass, takes what `Cost.at` returns there, and returns the
    minimum.
    """
    here, coordinates = start, cost.coordinates
    damping, share, settled, taken = 1e-3, 1.0, False, 0
    push, noise_decrement = np.zeros_like(here.levels), np.inf if noise else 0.0
    moved = True
    while taken < max_iterations:
        if noise is not None and moved and noise_decrement >= 0.1 * tolerance:  # else the noise levels have settled
            before = push
            push, noise_decrement = noise.step(here.last)
            # the expected information may be less than the curvature: steps that alternate in sign are too long
            share = 0.5 * share if push @ before < -0.25 * before @ before else min(1.0, 1.5 * share)
        dz, z, decrement = cost.step(here, damping)
        levels = here.levels * np.exp(share * push)
        free_step = damping <= STRONG_DAMPING
        enough = tolerance if free_step else NEGLIGIBLE
        settled = decrement < max(enough, NEARLY)
        if decrement < enough and (noise_decrement < enough or share < SMALLEST_SHARE):
            if free_step and noise is not None:  # with rough noise levels this step would go back to the prior
                here = replace(here, z=coordinates.clip(here.z + dz), levels=levels)
            break
        taken += 1
        there = yield z, levels
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
    if damping > STRONG_DAMPING and here.definite:  # the steps became short because the cost rose along them
        left = way_left(here, coordinates)
    return replace(here, settled=settled, iterations=taken, left=left)


def newton_step(matrix: Array, gradient: Array, held: NDArray[np.bool_]) -> Array:
    """Return the Newton step, zero for the coordinates that are `held` at a bound."""
    if not held.any():
        return np.asarray(np.linalg.solve(matrix, gradient), dtype=float)
    step, active = np.zeros_like(gradient), ~held
    step[active] = np.linalg.solve(matrix[np.ix_(active, active)], gradient[active])
    return step


def way_left(here: Minimum, coordinates: Coordinates) -> Array:
    """Return the Newton step from `here` to the solution of the estimating equation, at most `MAX_STEP` each."""
    full = newton_step(here.hessian, here.gradient, coordinates.held(here.z, here.gradient))
    return np.clip(full, -MAX_STEP, MAX_STEP)
