"""Nonlinear grey box as MATLAB's `nlgreyest` does it: a variable-step solver, least squares on the simulation error.

SciPy's RK45 stands for ode45, `least_squares` (trust region) with forward differences for `lsqnonlin`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from joint_id_core.data.recording import Array
from joint_id_core.models.operations import SignOps, SmoothOps
from reproduction.cases import Case
from reproduction.runs import Run

TOLERANCE = 1e-6  # relative, of the solver; MATLAB's default 1e-3 makes the differences rough
DIFFERENCE = 1e-4
SMOOTHING = 1e-3  # rad/s: the paper's "proper constant coefficient" is not printed


class _LimitError(Exception):
    """The time is up."""


class _Simulation:
    """Residuals of the labels by the logarithms of the free parameters over their start."""

    def __init__(self, case: Case, start: dict[str, float], smooth: bool, end_s: float) -> None:
        self.case, self.start, self.end_s = case, start, end_s
        self.ops = SmoothOps() if smooth else SignOps()
        self.smoothing = dict.fromkeys(case.model.smoothing.values(), SMOOTHING)
        self.z_best, self.lowest = np.zeros(len(case.free)), math.inf
        names = case.model.state_names
        self.columns = [names.index(n) for n in case.labels]
        y = np.column_stack([case.recording[n] for n in case.labels])
        if case.torsion:
            y = np.column_stack([y, self._torsion(case.states)])
        self.y = y
        # each label weighed by its size, as in the paper's Eq 2: without it angles would not count beside speeds
        self.weights = 1.0 / np.nanmax(np.abs(y), axis=0)
        inputs = [case.recording.channels.get(n, np.zeros(len(case.recording))) for n in case.model.input_names]
        self.u = np.column_stack(inputs)

    def _torsion(self, states: Array) -> Array:
        names = self.case.model.state_names
        return states[:, names.index("motor_position")] / self.case.truth["N"] - states[:, names.index("link_position")]

    def values(self, z: Array) -> dict[str, float]:
        free = {n: self.start[n] * math.exp(min(d, 50.0)) for n, d in zip(self.case.free, z, strict=True)}
        return {**self.case.truth, **free}

    def states(self, z: Array) -> Array:
        case = self.case
        p, t = SimpleNamespace(**{**self.values(z), **self.smoothing}), case.recording.time
        x = np.empty((len(t), len(case.model.states)))
        x[0] = case.states[0]
        constant = bool(np.all(self.u == self.u[0]))

        def slope(held: Array) -> Callable[[float, Array], list[float]]:
            def f(_: float, state: Array) -> list[float]:
                if time.process_time() > self.end_s:
                    raise _LimitError
                return list(case.model.derivative(state.tolist(), held.tolist(), p, self.ops))

            return f

        if constant:
            solved = solve_ivp(slope(self.u[0]), (t[0], t[-1]), x[0], t_eval=t, rtol=TOLERANCE, atol=1e-9)
            x[:] = np.nan
            x[: solved.y.shape[1]] = solved.y.T
            return x
        for k in range(len(t) - 1):  # sample by sample, since the input jumps there
            solved = solve_ivp(slope(self.u[k]), (t[k], t[k + 1]), x[k], rtol=TOLERANCE, atol=1e-9)
            x[k + 1] = solved.y[:, -1]
        return x

    def residuals(self, z: Array) -> Array:
        states = self.states(z)
        shown = states[:, self.columns]
        if self.case.torsion:
            shown = np.column_stack([shown, self._torsion(states)])
        r = np.nan_to_num(((shown - self.y) * self.weights).ravel(), nan=1e3, posinf=1e3, neginf=-1e3)
        if float(r @ r) < self.lowest:
            self.z_best, self.lowest = np.array(z), float(r @ r)
        return r


def fit(case: Case, seed: int, smooth: bool, limit_s: float) -> Run:
    """Fit for at most `limit_s`; where the time is up the best simulation so far is the result."""
    start, begun = case.start(seed), time.process_time()
    simulation = _Simulation(case, start, smooth, begun + limit_s)
    lower, upper = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    for k, name in enumerate(case.free):
        if case.bounds and name in case.bounds:
            lower[k], upper[k] = (math.log(end / start[name]) for end in case.bounds[name])
            lower[k], upper[k] = lower[k] - 1e-9, upper[k] + 1e-9
    try:
        found = least_squares(simulation.residuals, np.zeros(len(start)), bounds=(lower, upper), diff_step=DIFFERENCE)
        ended, z = ("converged" if found.status > 0 else "stopped"), found.x
    except _LimitError:
        ended, z = f"no end in {limit_s:g} s", simulation.z_best
    return Run(simulation.values(z), time.process_time() - begun, ended)
