"""Search for the maximum of the likelihood from the point where the Gauss-Newton iteration stalled.

That iteration follows the estimating equation, which neglects that the gain depends on the parameters. If the model is
incomplete, its steps may raise the cost. The point where it stops then depends on rounding. The likelihood has a
maximum nearby that does not depend on the path to it. It is found with derivatives by finite differences.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy  # whose parts load when used

from joint_id_core.data.recording import Array
from joint_id_core.estimators.innovations.gauss_newton import Cost, Minimum, way_left
from joint_id_core.estimators.innovations.noise import NoiseLevels

DIFFERENCE = 1e-3  # in standard deviations: the cost has 10 digits and is smooth over far longer distances
ENOUGH = 0.01  # change of half the cost at which the search ends: 0.14 standard deviations
MOST_ITERATIONS = 40
REACH = 4.0  # largest change: a factor 55 in a positive parameter or a variance; a longer step would be wrong
LEAST_INFORMATION = 0.1  # assumed on the logarithm of a noise level, so that a level without information moves little
BLOWN_UP = 1e4  # added to half the cost of the start where the path diverges
ROUGH = 1.0  # bend of half the cost over a difference beyond which differences are no slopes: a smooth one has 1e-6


class _Rough(Exception):
    """The cost jumps, so that differences are no slopes."""


def passes_each(found: Minimum) -> int:
    """Return the usual number of passes per iteration: one for every derivative, and two along the step."""
    return len(found.z) + len(found.levels) + 2


def most_likely(cost: Cost, bounds: NoiseLevels, found: Minimum, iterations: int) -> Minimum:
    """Minimise the cost near `found`, over coordinates and noise levels within their bounds.

    Method: sequential least squares programming (Kraft, DFVLR-FB 88-28, 1988). The integrator steps are those of
    `found`. After at most `iterations` iterations it returns the best point that it has seen, and at once where the
    cost is not smooth: all `iterations` then count as taken.
    """
    if iterations < 1:
        return found
    count = len(found.z)
    coordinates = cost.coordinates
    information = cost.recursion.noise_information(cost.recursion.renewed(found.last)).matrix
    unit = np.concatenate([np.diag(found.hessian), np.maximum(np.diag(information), LEAST_INFORMATION)]) ** -0.5
    lowest = np.concatenate([coordinates.lower, np.log(bounds.lower)])
    highest = np.concatenate([coordinates.upper, np.log(bounds.upper)])
    start = np.clip(np.concatenate([found.z, np.log(found.levels)]), lowest, highest)
    reach = REACH * np.concatenate([coordinates.unit, np.ones_like(found.levels)])
    lower, upper = np.maximum(start - reach, lowest), np.minimum(start + reach, highest)
    best, middle, value = found, np.full_like(start, np.inf), np.inf

    def passed(x: Array) -> float:
        nonlocal best
        y = np.clip(start + unit * x, lower, upper)
        here = cost.at(y[:count], np.exp(y[count:]), found.last.steps, found.substeps)
        if here is None:
            return 0.5 * found.cost + BLOWN_UP
        if here.cost < best.cost:
            best = here
        return 0.5 * here.cost

    def half_cost(x: Array) -> float:
        nonlocal middle, value
        half = passed(x)
        if np.max(np.abs(x - middle)) > 1.5 * DIFFERENCE:  # no difference, but a step
            middle, value = x.copy(), half
        elif abs(half - value) > ROUGH and abs(half + value - 2.0 * passed(0.5 * (x + middle))) > ROUGH:
            raise _Rough
        return half

    try:
        ended = scipy.optimize.minimize(
            half_cost, np.zeros_like(start), method="SLSQP",
            bounds=scipy.optimize.Bounds((lower - start) / unit, (upper - start) / unit),
            options={"eps": DIFFERENCE, "ftol": ENOUGH, "maxiter": min(iterations, MOST_ITERATIONS)},
        )  # fmt: skip
    except _Rough:
        taken, settled = iterations, False
    else:
        taken, settled = int(ended.nit), bool(ended.success)
    return replace(
        best, settled=found.settled or settled, iterations=found.iterations + taken, left=way_left(best, coordinates)
    )
