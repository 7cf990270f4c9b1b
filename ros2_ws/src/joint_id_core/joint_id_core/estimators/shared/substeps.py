"""Number of integrator steps per sample."""

from __future__ import annotations

import numpy as np

from joint_id_core.cell.kernel import Kernel
from joint_id_core.cell.rollout import Steps
from joint_id_core.data.recording import Array
from joint_id_core.estimators.shared.fit_data import FitData

# RK4 is stable up to |lambda h| = STABLE on the negative real axis. LIMIT stays below it; accuracy is checked later, by
# the fit with twice as many steps. MOST limits the steps for extreme intermediate parameter values, where accuracy is
# not needed.
STABLE, LIMIT = 2.78, 2.0
MOST = 8
POINTS = 8

# Close to standstill the slope of smoothed Coulomb friction gives by far the fastest mode; elsewhere this mode does not
# exist. So samples within KINK smoothing velocities of zero velocity, or that cross zero, take MORE_STEPS times as many
# steps, or as many as RK4 needs to be stable there.
KINK = 6.0
# Change of an input from one sample to the next, relative to its range in the record, that excites a fast mode. It is a
# little less than a tenth, so that rounding does not decide for a staircase of ten equal steps.
JUMP = 0.0999
MORE_STEPS = 8
MOST_STEPS = 64  # per sample; a joint at standstill takes extra steps in every sample
# A velocity that turns fast passes the smoothed step of friction within a small part of a sample. One step for each
# smoothing velocity resolves that. The few samples that change by more than FAST of them take up to MOST_TURNING steps.
FAST = 128.0
MOST_TURNING = 1024


def fastest_mode(data: FitData, kernel: Kernel, p: Array, states: Array, sliding: bool) -> float:
    """Return the largest |lambda| in 1/s of the linearised model at `POINTS` samples of the `states` (T, n).

    With `sliding` the velocities are moved away from standstill, where the slope of friction is only viscous.
    """
    at = (np.arange(POINTS) * ((len(data.time) - 1) / (POINTS - 1))).astype(int)
    X = states[at]
    if sliding:
        for velocity, smoothing in data.model.smoothing.items():
            i = data.model.state_names.index(velocity)
            least = 100.0 * p[data.model.parameter_names.index(smoothing)]
            X[:, i] = np.copysign(np.maximum(np.abs(X[:, i]), least), X[:, i])
    return _fastest(kernel, X, data.u[at], p)


def standing_mode(data: FitData, kernel: Kernel, p: Array, states: Array) -> float:
    """Return the largest |lambda| in 1/s at standstill; usually it comes from the slope of smoothed friction."""
    X = states[:1].copy()
    X[:, [data.model.state_names.index(velocity) for velocity in data.model.smoothing]] = 0.0
    return _fastest(kernel, X, data.u[:1], p)


def _fastest(kernel: Kernel, X: Array, u: Array, p: Array) -> float:
    A = np.empty((len(X), X.shape[1], X.shape[1]))
    kernel.module.jacobians(X, np.ascontiguousarray(u), p, A)
    return float(kernel.module.spectral_radius(A))


def stable_substeps(
    data: FitData, kernel: Kernel, p: Array, states: Array, limit: float = LIMIT, sliding: bool = False
) -> int:
    """Return the RK4 steps per sample with which |lambda h| <= limit for the fastest mode, at most `MOST`."""
    return int(np.clip(np.ceil(fastest_mode(data, kernel, p, states, sliding) * data.period / limit), 1, MOST))


def steps_of(data: FitData, kernel: Kernel, p: Array, states: Array, substeps: int) -> Steps:
    """Return the steps from each sample to the next, shape (T,).

    It is `substeps`, and more where `states` (T, n) are close to standstill or change direction, most where they do so
    fast. With the implicit cell it is also more where an input jumps: this cell is stable during the transient of a
    fast mode, but it is accurate only with steps as short as the time constant of that mode.
    """
    model = data.model
    more, fast = np.zeros(len(states), dtype=bool), np.zeros(len(states))
    for velocity, smoothing in model.smoothing.items():
        w, w_s = states[:, model.state_names.index(velocity)], p[model.parameter_names.index(smoothing)]
        near, turns = np.abs(w) < KINK * w_s, w[:-1] * w[1:] < 0.0
        more |= near
        more[:-1] |= near[1:] | turns
        fast[:-1] = np.maximum(fast[:-1], np.where(turns, np.abs(np.diff(w)) / w_s, 0.0))
    if kernel.cell == "implicit":
        more |= np.any(np.abs(np.diff(data.u, axis=0, prepend=0.0)) > JUMP * np.ptp(data.u, axis=0), axis=1)
    many = MORE_STEPS * substeps
    if more.any() and len(data.labels) < len(model.states):
        # measured states keep an unstable path near the data; with unmeasured states it would diverge
        many = steps_to_stand(data, kernel, p, states, substeps)
    steps = np.where(more, max(substeps, min(many, MOST_STEPS)), substeps)
    return np.where(fast > FAST, np.minimum(np.ceil(fast), MOST_TURNING), steps).astype(np.int64)


def steps_to_stand(
    data: FitData, kernel: Kernel, p: Array, states: Array, substeps: int, most: int = MOST_STEPS
) -> int:
    """Return the steps for a sample close to standstill, at most `most`.

    They are those for accuracy, or more if RK4 needs them there.
    """
    many = MORE_STEPS * substeps
    if kernel.cell == "rk4":
        mode = standing_mode(data, kernel, p, states)
        many = max(many, int(min(np.ceil(mode * data.period / STABLE), most)))
    return max(substeps, min(many, most))
