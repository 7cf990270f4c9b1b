"""CasADi: direct multiple shooting with a Gauss-Newton Hessian, solved by IPOPT (MUMPS), evaluated in compiled C.

Every sample is a shooting node, as in CasADi's own example of system identification: the RK4 cell is mapped over the
samples, the states start at the labels, and continuity is a constraint. At the solution all gaps are closed: it is the
minimum of the simulation error, and a noisy input biases it as it does single shooting. `casadi_disturbance` gives the
same program the noise of the torque as further unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi
import numpy as np

from peers.model2 import FREE, MAX_ITERATIONS, MODEL, STATES, SUBSTEPS, Data, Fit, Ops, parameters, processor_s, rk4
from peers.model2 import values as parameter_values

OPS = Ops(casadi)
INPUTS = len(MODEL.inputs)
# Compiled code takes 15 ms an iteration at 1000 samples, CasADi's virtual machine 140 ms.
COMPILER: dict[str, Any] = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2", "-march=native"]}}
# Of the scaled optimality conditions; ten times less changes the estimates in their seventh digit.
TOLERANCE = 1e-4


def cell() -> Any:
    """The state one sample later: function of x (4), u (2), dt and the logarithms of the free parameters (9)."""
    x, u, dt = casadi.SX.sym("x", STATES), casadi.SX.sym("u", INPUTS), casadi.SX.sym("dt")
    z = casadi.SX.sym("z", len(FREE))
    p = parameters([casadi.exp(z[k]) for k in range(len(FREE))])

    def slope(x: Any) -> Any:
        return casadi.vertcat(*MODEL.derivative(casadi.vertsplit(x), casadi.vertsplit(u), p, OPS))

    later = x
    for _ in range(SUBSTEPS):
        later = rk4(slope, later, dt / SUBSTEPS)
    return casadi.Function("cell", [x, u, dt, z], [later])


@lru_cache(maxsize=32)
def solver(samples: int, torque_noise: float, limit_s: float) -> Any:
    """The nonlinear program for records of this length.

    Unknown are the logarithms of the parameters, every state as its distance from its label in standard deviations, and
    where the measured torque has a noise (`torque_noise` in Nm) also this at every sample, in standard deviations.
    Given are labels, inputs, steps and the standard deviations of the labels, in one vector.
    """
    z, e = casadi.MX.sym("z", len(FREE)), casadi.MX.sym("e", STATES, samples)
    y, u = casadi.MX.sym("y", STATES, samples), casadi.MX.sym("u", INPUTS, samples)
    dt, sigma = casadi.MX.sym("dt", 1, samples - 1), casadi.MX.sym("sigma", STATES)
    w = casadi.MX.sym("w", 1, samples - 1 if torque_noise else 0)
    x, held = y + e * casadi.repmat(sigma, 1, samples), u[:, :-1]
    if torque_noise:
        held = held + casadi.vertcat(torque_noise * w, casadi.DM.zeros(INPUTS - 1, samples - 1))
    later = cell().map(samples - 1)(x[:, :-1], held, dt, casadi.repmat(z, 1, samples - 1))
    gaps = (later - x[:, 1:]) / casadi.repmat(sigma, 1, samples - 1)
    unknown, given, g = casadi.veccat(z, e, w), casadi.veccat(y, u, dt, sigma), casadi.vec(gaps)
    # Gauss-Newton: the residuals are unknowns themselves, so the Hessian is constant; the curvature of the constraints
    # is left out.
    ones = casadi.DM(np.concatenate([np.zeros(len(FREE)), np.ones(unknown.shape[0] - len(FREE))]))
    factor, multipliers = casadi.MX.sym("factor"), casadi.MX.sym("multipliers", g.shape[0])
    hessian = casadi.Function(
        "nlp_hess_l",
        [unknown, given, factor, multipliers],
        [factor * casadi.MX(casadi.diag(ones))],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    ipopt: dict[str, Any] = {"max_iter": MAX_ITERATIONS, "tol": TOLERANCE, "max_cpu_time": limit_s}
    ipopt |= {"print_level": 0, "sb": "yes"}
    quiet: dict[str, Any] = {"print_time": False, "show_eval_warnings": False}
    program = {"x": unknown, "p": given, "f": 0.5 * (casadi.sumsqr(e) + casadi.sumsqr(w)), "g": g}
    return casadi.nlpsol("solver", "ipopt", program, {"hess_lag": hessian, "ipopt": ipopt, **quiet, **COMPILER})


def fit(data: Data, start: Mapping[str, float], limit_s: float, torque_noise: float = 0.0) -> Fit:
    """Fit from `start`, for at most `limit_s` of processor time."""
    begun = processor_s()
    samples = len(data.recording)
    solve = solver(samples, torque_noise, limit_s)
    built = processor_s()
    given = np.concatenate([data.y.ravel(), data.u.ravel(), np.diff(data.recording.time), data.sigma])
    first = np.zeros(solve.size1_in("x0"))
    first[: len(FREE)] = np.log([start[name] for name in FREE])
    found = solve(x0=first, p=given, lbg=0.0, ubg=0.0)
    seconds = processor_s() - built
    outcome = solve.stats()
    return Fit(
        parameter_values(found["x"]), seconds, built - begun, int(outcome["iter_count"]), bool(outcome["success"])
    )
