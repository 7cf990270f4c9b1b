"""JAX with optimistix: Levenberg-Marquardt on the simulation error, RK4 in a `lax.scan`, forward-mode Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from peers.model2 import (
    COST_TOLERANCE,
    FREE,
    MAX_ITERATIONS,
    MODEL,
    ROUGH_COST_TOLERANCE,
    ROUGH_MAX_ITERATIONS,
    ROUGH_STEP_TOLERANCE,
    STATES,
    STEP_TOLERANCE,
    SUBSTEPS,
    Data,
    Fit,
    Ops,
    horizons,
    parameters,
    processor_s,
    rk4,
    unknowns,
    values,
)

jax.config.update("jax_enable_x64", True)

OPS = Ops(jnp)


def residuals(z: Any, arguments: tuple[Any, ...]) -> Any:
    """Simulation minus labels in standard deviations, shape (T, 4)."""
    u, y, dt, sigma = arguments
    p = parameters(tuple(jnp.exp(z[: len(FREE)])))

    def advance(x: Any, sample: Any) -> Any:
        u, dt = sample

        def slope(x: Any) -> Any:
            return jnp.stack(MODEL.derivative(tuple(x), tuple(u), p, OPS))

        # Of the ways to write this one is the fastest with its Jacobian: states stacked, substeps in a loop of their
        # own (6 ms at 1000 samples); substeps unrolled over scalars take 18 ms and ten times as long to compile.
        x = jax.lax.fori_loop(0, SUBSTEPS, lambda _, x: rk4(slope, x, dt / SUBSTEPS), x)
        return x, x

    x0 = y[0] + sigma * z[len(FREE) :]
    _, x = jax.lax.scan(advance, x0, (u[:-1], dt))
    return (jnp.concatenate([x0[None], x]) - y) / sigma


@lru_cache(maxsize=32)
def compiled(samples: int, last: bool) -> Any:
    """The solver for records of this length, compiled ahead of time."""
    cost, step = (COST_TOLERANCE, STEP_TOLERANCE) if last else (ROUGH_COST_TOLERANCE, ROUGH_STEP_TOLERANCE)
    # optimistix stops when |dz| < atol + rtol |z| and |dcost| < atol + rtol |cost|: with rtol for the cost, atol for z.
    solver: Any = optimistix.LevenbergMarquardt(rtol=cost, atol=step)
    limit = MAX_ITERATIONS if last else ROUGH_MAX_ITERATIONS

    def solve(z: Any, arguments: tuple[Any, ...]) -> Any:
        found: Any = optimistix.least_squares(
            residuals, solver, z, arguments, options={"jac": "fwd"}, max_steps=limit, throw=False
        )
        return found.value, found.stats["num_steps"], found.result == optimistix.RESULTS.successful

    shapes = [(len(FREE) + STATES,), (samples, 2), (samples, 4), (samples - 1,), (4,)]
    z, *arguments = (jax.ShapeDtypeStruct(shape, jnp.float64) for shape in shapes)
    return jax.jit(solve).lower(z, tuple(arguments)).compile()


def fit(data: Data, start: Mapping[str, float], limit_s: float) -> Fit:
    """Fit from `start`; compiled code cannot be stopped, so `limit_s` counts between the horizons only."""
    z, iterations, seconds, setup_s, finished = jnp.asarray(unknowns(start)), 0, 0.0, 0.0, False
    for part, last in horizons(data):
        begun = processor_s()
        solve = compiled(len(part.recording), last)
        built = processor_s()
        setup_s += built - begun
        arguments = (part.u, part.y, np.diff(part.recording.time), part.sigma)
        z, steps, good = solve(z, tuple(jnp.asarray(a) for a in arguments))
        iterations, finished = iterations + int(steps), bool(good)
        seconds += processor_s() - built
        if seconds > limit_s:
            finished = finished and last
            break
    return Fit(values(z), seconds, setup_s, iterations, finished)
