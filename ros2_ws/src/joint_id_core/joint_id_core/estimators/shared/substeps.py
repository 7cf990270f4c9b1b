"""How many steps of the integrator each sample needs."""

from __future__ import annotations

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.fit_data import FitData

# RK4 is stable up to this |lambda h| on the negative real axis; LIMIT keeps away from it, accuracy is left to the
# doubling test of the fit. The cap is for wild intermediate parameter values, whose fits need not be accurate.
STABLE, LIMIT = 2.78, 2.0
MOST = 8
POINTS = 8

# Close to standstill the slope of smoothed Coulomb friction is by far the fastest mode, elsewhere there is none:
# samples that come within KINK smoothing velocities of zero, or cross it, take MORE_STEPS times as many steps, or as
# many as RK4 needs there to be stable.
KINK = 6.0
# Change of an input from one sample to the next, of its range in the record, that sets a fast mode going. A little less
# than a tenth, so that rounding does not decide for a staircase of ten equal steps.
JUMP = 0.0999
MORE_STEPS = 8
MOST_STEPS = 64  # a joint that stands still takes them in every sample


def fastest_mode(data: FitData, kernel: Kernel, p: Array, states: Array, sliding: bool) -> float:
    """Largest |lambda| in 1/s of the linearised model at a few points of the record, `states` (T, n).

    With `sliding` friction is taken far from standstill, where its slope is only the viscous one.
    """
    at = np.unique(np.linspace(0, len(data.time) - 1, POINTS).astype(int))
    X = states[at]
    if sliding:
        for velocity, smoothing in data.model.smoothing.items():
            i = data.model.state_names.index(velocity)
            least = 100.0 * p[data.model.parameter_names.index(smoothing)]
            X[:, i] = np.copysign(np.maximum(np.abs(X[:, i]), least), X[:, i])
    return _fastest(kernel, X, data.u[at], p)


def standing_mode(data: FitData, kernel: Kernel, p: Array, states: Array) -> float:
    """Largest |lambda| in 1/s at standstill, where it is the slope of smoothed friction as a rule."""
    X = states[:1].copy()
    X[:, [data.model.state_names.index(velocity) for velocity in data.model.smoothing]] = 0.0
    return _fastest(kernel, X, data.u[:1], p)


def _fastest(kernel: Kernel, X: Array, u: Array, p: Array) -> float:
    A = np.empty((len(X), X.shape[1], X.shape[1]))
    kernel.module.jacobians(X, np.ascontiguousarray(u), p, A)
    return float(np.max(np.abs(np.linalg.eigvals(A)))) if np.isfinite(A).all() else np.inf


def stable_substeps(
    data: FitData, kernel: Kernel, p: Array, states: Array, limit: float = LIMIT, sliding: bool = False
) -> int:
    """RK4 steps a sample so that |lambda h| <= limit for the fastest mode, at most `MOST`."""
    return int(np.clip(np.ceil(fastest_mode(data, kernel, p, states, sliding) * data.period / limit), 1, MOST))


def steps_of(data: FitData, kernel: Kernel, p: Array, states: Array, substeps: int) -> Steps:
    """Steps from each sample to the next, shape (T,): `substeps`, more where friction turns, as `states` (T, n) say.

    With the implicit cell there are also more where an input jumps: it stays stable over the transient of a fast mode,
    but follows it only with steps of that mode's time.
    """
    model = data.model
    more = np.zeros(len(states), dtype=bool)
    for velocity, smoothing in model.smoothing.items():
        w = states[:, model.state_names.index(velocity)]
        near = np.abs(w) < KINK * p[model.parameter_names.index(smoothing)]
        more |= near
        more[:-1] |= near[1:] | (w[:-1] * w[1:] < 0.0)
    if kernel.cell == "implicit":
        more |= np.any(np.abs(np.diff(data.u, axis=0, prepend=0.0)) > JUMP * np.ptp(data.u, axis=0), axis=1)
    many = MORE_STEPS * substeps
    if kernel.cell == "rk4" and more.any() and len(data.labels) < len(model.states):
        # labels of all states hold the path, with fewer an unstable one is lost
        mode = standing_mode(data, kernel, p, states)
        many = max(many, int(min(np.ceil(mode * data.period / STABLE), MOST_STEPS)))
    return np.where(more, max(substeps, min(many, MOST_STEPS)), substeps).astype(np.int64)
