"""SciPy: `least_squares` on the simulation error of `solve_ivp`, Jacobian by finite differences.

The way of MATLAB's `nlgreyest`: a variable-step solver, Coulomb friction smoothed by tanh, no derivatives of the model.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from joint_id_core.data.recording import Array
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
    Data,
    Fit,
    Ops,
    horizons,
    parameters,
    processor_s,
    unknowns,
    values,
)

OPS = Ops(np)
DIFFERENCE = 1e-4  # step of the finite differences, in the logarithms and in standard deviations of the start state
# Of one step, in standard deviations of the labels; over 2 s they add up to 0.2. A tenth takes half as long again.
LOCAL_ERROR = 1e-4


class _LimitError(Exception):
    """The time is up."""


class _Simulation:
    """Residuals of a record, by the unknowns as distance from their start.

    As distance, because the first trust region is as large as the unknowns are: the norm of the logarithms themselves
    is 20, and a first step of that length throws parameters away by e^17. From zero it is 1.
    """

    def __init__(self, data: Data, origin: Array, end_s: float) -> None:
        self.data, self.origin, self.end_s = data, origin, end_s
        self.best, self.lowest = np.zeros(0), np.inf

    def run(self, z: Array) -> Array:
        """Residuals in standard deviations, shape (T, 4, B), of the distances z of shape (B, 13)."""
        data, size, z = self.data, len(z), self.origin + z
        time, u = data.recording.time, data.u
        p = parameters(tuple(np.exp(z[:, : len(FREE)]).T))
        x = np.empty((len(time), STATES * size))
        x[0] = (data.y[0] + data.sigma * z[:, len(FREE) :]).T.ravel()
        atol = LOCAL_ERROR * np.repeat(data.sigma, size)
        # Sample by sample, because the input jumps there: an integration across the jumps was ten times less accurate.
        for k in range(len(time) - 1):

            def slope(_: float, x: Array, held: Array = u[k]) -> Array:
                if processor_s() > self.end_s:
                    raise _LimitError
                return np.concatenate(MODEL.derivative(tuple(x.reshape(STATES, size)), tuple(held), p, OPS))

            span = (time[k], time[k + 1])
            solved = solve_ivp(slope, span, x[k], t_eval=[span[1]], first_step=span[1] - span[0], rtol=1e-9, atol=atol)
            if not solved.success:
                x[k + 1 :] = np.nan
                break
            x[k + 1] = solved.y[:, -1]
        return (x.reshape(len(time), STATES, size) - data.y[:, :, None]) / data.sigma[:, None]

    def residuals(self, z: Array) -> Array:
        """Shape (4 T,); large where the simulation leaves the finite numbers, so that the step is refused."""
        r = np.nan_to_num(self.run(z[None])[:, :, 0].ravel(), nan=1e9, posinf=1e9, neginf=-1e9)
        cost = float(r @ r)
        if cost < self.lowest:
            self.best, self.lowest = z.copy(), cost
        return r

    def jacobian(self, z: Array) -> Array:
        """Shape (4 T, 13), by forward differences.

        All 14 simulations are one system of 56 states: they share the steps of the solver, which makes the differences
        smooth, and take as long as one alone.
        """
        r = self.run(np.vstack([z, z + DIFFERENCE * np.eye(len(z))]))
        return np.nan_to_num((r[:, :, 1:] - r[:, :, :1]) / DIFFERENCE).reshape(-1, len(z))


def fit(data: Data, start: Mapping[str, float], limit_s: float) -> Fit:
    """Fit from `start`, for at most `limit_s` of processor time."""
    begun = processor_s()
    origin, iterations, finished = unknowns(start), 0, False
    z = np.zeros_like(origin)
    for part, last in horizons(data):
        simulation = _Simulation(part, origin, begun + limit_s)
        cost, step = (COST_TOLERANCE, STEP_TOLERANCE) if last else (ROUGH_COST_TOLERANCE, ROUGH_STEP_TOLERANCE)
        most = MAX_ITERATIONS if last else ROUGH_MAX_ITERATIONS
        try:
            found = least_squares(
                simulation.residuals, z, simulation.jacobian, ftol=cost, xtol=step, gtol=None, max_nfev=most
            )
        except _LimitError:
            z = simulation.best if simulation.best.size else z
            break
        z, iterations, finished = found.x, iterations + int(found.njev or 0), last and found.status > 0
    return Fit(values(origin + z), processor_s() - begun, 0.0, iterations, finished)
